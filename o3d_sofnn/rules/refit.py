"""Stage 4: rules are fitted again where it is doubtful which points belong to them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.rules.rule_base import RuleBase, fit_rules
from o3d_sofnn.sampling.local_fit import RADIUS, Neighborhoods

UNDISPUTED = 0.95
"""Share of the neighbourhood facing the side of a rule above which all of it belongs there."""


def revise(
    rules: RuleBase,
    tree: KdTree,
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
) -> RuleBase:
    """Fit rules beside edges and other sheets again, with the inferred normals.

    Which points count in a fit depends on their normals, which are known better after the rules
    have been fitted. Where all points of a neighbourhood agree, nothing would change.

    Parameters
    ----------
    rules : RuleBase
        Rules fitted with other normals.
    tree : KdTree
        Over `points`.
    points, normals : (n, 3) float64
        Distinct points, and the normals inferred at those that :func:`read_normals` marks.

    Returns
    -------
    RuleBase
        The same number of rules; those that were fitted again come last.
    """
    disputed = _disputed(rules)
    if not disputed.any():
        return rules
    again = rules.rows(disputed)
    # A rule between two faces joins one of them; its own normal may lie between theirs.
    side = normals[tree.query(again.feet, 1, np.inf)[1][:, 0]]
    same = np.einsum("rd,rd->r", side, again.normals) > 0.0
    side = np.where(same[:, None], side, again.normals)
    where = Neighborhoods(
        again.feet, side, again.n_neighbors, again.noise, again.ellipses[0], again.stretch
    )
    fits = fit_rules(tree, points, normals, where, again.confidence)
    return rules.rows(~disputed).joined(fits)


def read_normals(rules: RuleBase, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark the points whose normals :func:`revise` reads, and some others around them.

    Parameters
    ----------
    rules : RuleBase
        Rules fitted to `points`.
    points : (n, 3) float64
        Distinct points.

    Returns
    -------
    (n,) bool
    """
    again = rules.rows(_disputed(rules))
    if not len(again):
        return np.zeros(len(points), bool)
    # The new neighbourhood has as many points around the foot as the old one around the centre.
    moved = np.linalg.norm(again.feet - again.centers, axis=1)
    reach = np.sqrt(again.stretch) * again.radius / RADIUS + moved
    widest = np.full(len(points), 1.001 * reach.max())  # the margin exceeds the rounding of radii
    return np.asarray(again.foot_tree.crowded(points, 1, widest), bool)


def _disputed(rules: RuleBase) -> NDArray[np.bool_]:
    return np.asarray(rules.support < UNDISPUTED)
