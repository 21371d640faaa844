"""Stage 5: one side per rule, from a global criterion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from ._kernels import KdTree, WindingTree
from .octree import build_octree
from .rules import RuleBase

REPRESENTATIVES = 8000
"""Largest number of unknowns of the global problem."""
ITERATIONS = 40
WIDTHS = (3.0, 0.7)
"""Smoothing width at the first and the last iteration, over the distance of representatives."""
OPENING = 0.5
"""Opening angle of the tree code: a node is summed at its centre when it looks smaller."""


def representatives(rules: RuleBase) -> NDArray[np.float64]:
    """Combine rules that lie close together into at most 8000 representatives.

    Parameters
    ----------
    rules : RuleBase
        Rules with or without consistent sides.

    Returns
    -------
    (m, 3) float64
        Mean feet of octree leaves, in Morton order.
    """
    capacity = max(1, 2 * len(rules) // REPRESENTATIVES)
    cells = build_octree(rules.feet, capacity)
    count = np.diff(cells.offsets)
    return np.add.reduceat(cells.points, cells.offsets[:-1]) / count[:, None]


def winding_number_normals(
    x: NDArray[np.float64], spacing: float, n_threads: int
) -> NDArray[np.float64]:
    """Find normals whose winding number is one half on the surface and that are its gradient.

    Lin, Shi and Liu, "Fast and globally consistent normal orientation based on the winding number
    normal consistency" (2024): a gradient step on ``|A mu - 1/2|^2`` alternates with
    ``mu <- |mu| * unit(-grad(winding number of mu))``, with a smoothing width that shrinks.

    Parameters
    ----------
    x : (m, 3) float64
        Positions, close to the surface.
    spacing : float
        Typical distance of neighbouring positions.
    n_threads : int
        Threads.

    Returns
    -------
    (m, 3) float64
        Area-weighted outward normals.
    """
    order = np.asarray(WindingTree(x, np.ones(len(x))).order())
    sorted_x = np.ascontiguousarray(x[order])
    tree = WindingTree(sorted_x, np.ones(len(x)))
    mu = np.zeros_like(sorted_x)
    for step in np.linspace(0.0, 1.0, ITERATIONS):
        width = np.full(len(x), spacing * WIDTHS[0] * (WIDTHS[1] / WIDTHS[0]) ** step)

        def winding(m: NDArray[np.float64], w: NDArray[np.float64] = width) -> NDArray[np.float64]:
            return np.asarray(tree.evaluate(m, None, sorted_x, w, OPENING, n_threads)[0])

        error = 0.5 - winding(mu)
        descent = -tree.evaluate(None, error, sorted_x, width, OPENING, n_threads)[2]
        response = winding(descent)
        scale = float((response**2).sum())
        if scale > 0:
            mu = mu + float((descent**2).sum()) / scale * descent
        gradient = tree.evaluate(mu, None, sorted_x, width, OPENING, n_threads)[1]
        length = np.linalg.norm(mu, axis=1, keepdims=True)
        mu = length * gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-300)
    result = np.empty_like(mu)
    result[order] = mu
    return result


def orient(rules: RuleBase, n_threads: int) -> tuple[RuleBase, tuple[str, ...]]:
    """Turn the normals of all rules outwards.

    Parameters
    ----------
    rules : RuleBase
        Rules with normals of unknown sign.
    n_threads : int
        Threads.

    Returns
    -------
    rules : RuleBase
        The same rules turned, with the confidence of the decision.
    warnings : tuple of str
        Said when the side of a piece is a guess.
    """
    x = representatives(rules)
    tree = KdTree(x, n_threads)
    near = tree.query(x, min(5, len(x)), np.inf, n_threads)[0]
    spacing = float(np.median(near[:, 1:])) if len(x) > 1 else 1.0
    mu = winding_number_normals(x, spacing, n_threads)
    direction = mu / np.maximum(np.linalg.norm(mu, axis=1, keepdims=True), 1e-300)
    distance, index = tree.query(rules.feet, min(4, len(x)), np.inf, n_threads)
    weight = np.exp(-((distance / spacing) ** 2)) + 1e-12
    vote = np.einsum("rk,rkd->rd", weight / weight.sum(axis=1, keepdims=True), direction[index])
    turned = rules.facing(vote)
    confidence = np.abs(np.einsum("rd,rd->r", turned.normals, vote))
    return replace(turned, confidence=confidence), ()


def face(
    rules: RuleBase,
    viewpoint: NDArray[np.float64] | None,
    towards: NDArray[np.float64] | None,
    n_threads: int,
) -> RuleBase:
    """Turn rules to where the user wants them to face.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    viewpoint : (3,) float64 or None
        Every rule faces this place.
    towards : (3,) float64 or None
        Every connected piece faces this direction in the mean.
    n_threads : int
        Threads.

    Returns
    -------
    RuleBase
    """
    if viewpoint is not None:
        return rules.facing(viewpoint - rules.feet)
    if towards is not None:
        piece = pieces(rules, n_threads)
        lean = np.bincount(piece, rules.areas * (rules.normals @ towards))
        return rules.facing(rules.normals * np.where(lean < 0, -1.0, 1.0)[piece][:, None])
    return rules


def pieces(rules: RuleBase, n_threads: int) -> NDArray[np.int64]:
    """Number the connected pieces of the rule base: rules within each other's radius.

    Parameters
    ----------
    rules : RuleBase
        Rules.
    n_threads : int
        Threads.

    Returns
    -------
    (r,) int64
        Piece of each rule.
    """
    k = min(9, len(rules))
    tree = KdTree(rules.feet, n_threads)
    distance, index = tree.query(rules.feet, k, np.inf, n_threads)
    near = distance <= np.minimum(rules.radius[:, None], rules.radius[index])
    row, column = np.nonzero(near)
    graph = scipy.sparse.coo_matrix(
        (np.ones(len(row)), (row, index[row, column])), shape=(len(rules), len(rules))
    )
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1], np.int64)
