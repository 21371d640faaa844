"""Connected components of the rule base, and sides of points that follow those of rules."""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from o3d_sofnn.rules.rule_base import RuleBase


def turn_along(
    sides: NDArray[np.float64],
    points: NDArray[np.float64],
    before: RuleBase,
    after: RuleBase,
    replaced: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Flip the sides of points whose rule was flipped.

    Parameters
    ----------
    sides, points : (n, 3) float64
        Points and their sides, consistent with `before`.
    before, after : RuleBase
        The same rules with other signs.
    replaced : (r,) bool
        Rules whose sign was decided independently of the earlier one: points follow the nearest of
        these, if one is among the four nearest rules.

    Returns
    -------
    (n, 3) float64
        New sides. Other points follow the nearest of four rules that was on their side.
    """
    turned = np.einsum("rd,rd->r", before.normals, after.normals) < 0.0
    if not (turned.any() or replaced.any()):
        return sides
    index = before.foot_tree.query(points, min(4, len(before)), np.inf)[1]
    same = np.einsum("nkd,nd->nk", before.normals[index], sides) > 0.0
    first = index[np.arange(len(points)), same.argmax(axis=1)]
    new = index[np.arange(len(points)), replaced[index].argmax(axis=1)]
    against = np.einsum("nd,nd->n", after.normals[new], sides) < 0.0
    flip = np.where(replaced[new], against, turned[first] & same.any(axis=1))
    return np.where(flip[:, None], -sides, sides)


def pieces(rules: RuleBase) -> NDArray[np.int64]:
    """Find the connected components of the rule base (rules within each other's radius).

    Parameters
    ----------
    rules : RuleBase
        Rules.

    Returns
    -------
    (r,) int64
        Component of each rule.
    """
    k = min(9, len(rules))
    distance, index = rules.foot_tree.query(rules.feet, k, np.inf)
    near = distance <= np.minimum(rules.radius[:, None], rules.radius[index])
    row, column = np.nonzero(near)
    graph = scipy.sparse.coo_matrix(
        (np.ones(len(row)), (row, index[row, column])), shape=(len(rules), len(rules))
    )
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1], np.int64)
