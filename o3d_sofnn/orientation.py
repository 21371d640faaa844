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
ALIKE = 0.7
"""Least cosine between the planes of neighbouring rules that hand on a sign."""
CLOSED = 0.72
"""Share of a piece with nothing in front of it from which on it counts as closed."""
RISE = 0.7
"""Largest rise of the step between them over both planes together, over its length."""
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
    turned = unify(rules.facing(vote), n_threads)
    confidence = np.abs(np.einsum("rd,rd->r", turned.normals, vote))
    return replace(turned, confidence=confidence), ()


def unify(rules: RuleBase, n_threads: int) -> RuleBase:
    """Make sheets consistent that the winding number cannot decide: open ones.

    Hoppe et al. 1992: signs are handed on along a spanning tree of the rules whose edges prefer
    equal tangent planes; only edges that run along the surface count, so that the sides of a thin
    wall are not joined. The tree replaces the winding number's signs only on a connected piece that
    is open (one spacing in front of it the winding number is not zero) and only when it leaves less
    than half as many edges in contradiction; the whole piece keeps the side that most of it had.

    Parameters
    ----------
    rules : RuleBase
        Rules with the signs of the winding number.
    n_threads : int
        Threads.

    Returns
    -------
    RuleBase
    """
    n, normals, feet = len(rules), rules.normals, rules.feet
    index = KdTree(feet, n_threads).query(feet, min(9, n), np.inf, n_threads)[1][:, 1:]
    a, b = np.repeat(np.arange(n), index.shape[1]), index.ravel()
    step = feet[b] - feet[a]
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-300)
    rise = np.abs(np.einsum("ed,ed->e", step, normals[a])) + np.abs(
        np.einsum("ed,ed->e", step, normals[b])
    )
    cosine = np.einsum("ed,ed->e", normals[a], normals[b])
    along = (np.abs(cosine) > ALIKE) & (rise < RISE * length)
    a, b, cosine = a[along], b[along], cosine[along]
    graph = scipy.sparse.coo_matrix((1.0 - np.abs(cosine) + 1e-6, (a, b)), shape=(n, n)).tocsr()
    tree = scipy.sparse.csgraph.minimum_spanning_tree(graph.maximum(graph.T))
    piece = scipy.sparse.csgraph.connected_components(tree, directed=False)[1]
    sign = _signs_along(tree, normals, piece)
    area = rules.areas
    side = np.bincount(piece, area * sign)
    sign = sign * np.where(side < 0, -1.0, 1.0)[piece]
    pieces_of_edges, count = piece[a], int(piece.max()) + 1
    before = np.bincount(pieces_of_edges, cosine < 0, count)
    after = np.bincount(pieces_of_edges, sign[a] * sign[b] * cosine < 0, count)
    closed = np.bincount(piece, area * empty_in_front(rules, n_threads)) / np.bincount(piece, area)
    replaced = ((after < 0.5 * before) & (closed < CLOSED))[piece]
    return rules.facing(normals * np.where(replaced, sign, 1.0)[:, None])


def empty_in_front(rules: RuleBase, n_threads: int) -> NDArray[np.bool_]:
    """Whether the winding number one spacing in front of each rule is that of the outside.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    n_threads : int
        Threads.

    Returns
    -------
    (r,) bool
        True nearly everywhere on a closed surface, on less than half of an open one.
    """
    feet, normals = rules.feet, rules.normals
    area = cell_areas(feet, n_threads)
    spacing = float(np.sqrt(np.median(area)))
    tree = WindingTree(feet, area)
    x = np.ascontiguousarray(feet + spacing * normals)
    width = np.full(len(x), 0.7 * spacing)
    winding = tree.evaluate(area[:, None] * normals, None, x, width, OPENING, n_threads)[0]
    return np.asarray(np.abs(winding) < 0.25)


def cell_areas(x: NDArray[np.float64], n_threads: int) -> NDArray[np.float64]:
    """Area of surface around each sample, from the distance of its neighbours.

    Parameters
    ----------
    x : (n, 3) float64
        Samples.
    n_threads : int
        Threads.

    Returns
    -------
    (n,) float64
        ``pi r_k^2 / k`` with the k nearest.
    """
    k = min(9, len(x))
    distance, _ = KdTree(x, n_threads).query(x, k, np.inf, n_threads)
    return np.asarray(np.pi * distance[:, -1] ** 2 / max(k - 0.5, 1.0))


def _signs_along(
    tree: scipy.sparse.csr_matrix, normals: NDArray[np.float64], piece: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Sign of each node relative to the first one of its piece, multiplied along the tree."""
    n = len(normals)
    first = np.unique(piece, return_index=True)[1]
    rows = np.concatenate([np.full(len(first), n), tree.tocoo().row])
    columns = np.concatenate([first, tree.tocoo().col])
    rooted = scipy.sparse.coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(n + 1, n + 1))
    order, parent = scipy.sparse.csgraph.breadth_first_order(rooted.tocsr(), n, directed=False)
    parent[n] = n
    relative = np.ones(n + 1)
    inner = np.flatnonzero(parent[:n] < n)
    product = np.einsum("rd,rd->r", normals[inner], normals[parent[inner]])
    relative[inner] = np.where(product < 0, -1.0, 1.0)
    sign = relative.copy()
    above = parent.copy()
    for _ in range(int(np.ceil(np.log2(len(order) + 1))) + 1):  # pointer doubling up the tree
        sign, above = sign * np.where(above < n, sign[above], 1.0), above[above]
    return sign[:n]


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
    """Give each connected piece of the rule base (rules within each other's radius) a number.

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
