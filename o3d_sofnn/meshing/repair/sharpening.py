"""Sharp edges: vertices beside a sharp edge are moved onto it.

Marching cubes places vertices on the edges of cubes only, so that a sharp edge of the surface is
cut off within every cube. The tangent planes around a vertex meet on the edge (Kobbelt et al. 2001,
"Feature sensitive surface extraction"; with planes at the middle of each triangle as in Ohtake and
Belyaev 2002, "Dual/primal mesh optimization").
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import bent_vertices, surroundings, undo_turns
from o3d_sofnn.geometry.mesh_properties import with_corner_in

if TYPE_CHECKING:
    from o3d_sofnn.implicit.field import Evaluate

SHARP = 0.9
"""Cosine between the normals of a vertex and of one of its triangles below which it is moved."""


STEP = 0.1
"""Step of the numerical gradient, divided by the length of the edges."""


SLOPE = (0.3, 3.0)
"""Range of the gradient's length of a distance-like function; outside it, no zero is searched."""


SUPPORTED = 0.5
"""Support by the data above which tangent planes are used, and vertices moved to their meeting."""


DISTINCT = 0.05
"""Smallest share of a direction in the planes' normals that counts: along an edge it is zero."""


REACH = 2.0
"""Longest way of a vertex, divided by the length of its edges."""


TURN = 0.2
"""Smallest cosine between the normals of a triangle before and after."""


ROUNDS = 8
"""Number of rounds; neighbours do not move in the same round, except in the last one."""


Array = NDArray[np.float64]


def sharpen(
    vertices: Array,
    triangles: NDArray[np.int32],
    evaluate: Evaluate,
) -> Array:
    """Move the vertices beside sharp edges and corners onto them.

    Of the vertices on the two sides of an edge, those with the shortest ways move first: if they
    moved together, nothing would be left of the triangles between them. A vertex moves back if a
    triangle would flip.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A closed mesh.
    evaluate : callable
        Maps (m, 3) queries to (m,) signed distances and (m,) support.

    Returns
    -------
    (m, 3) float64
        New positions; vertices on smooth parts do not move.
    """
    normals, _, lengths = map(np.asarray, surroundings(vertices, triangles))
    sharp = np.asarray(bent_vertices(vertices, triangles, normals, SHARP)) > 0
    around = triangles[with_corner_in(sharp, triangles)]
    if not len(around):
        return vertices
    middle = vertices[around].mean(axis=1)
    places, planes, valid = touching_planes(middle, lengths[around].mean(axis=1), evaluate)
    corner = around[valid].ravel().astype(np.int64)
    places, planes = (np.repeat(x[valid], 3, axis=0) for x in (places, planes))
    offset = ((places - vertices[corner]) * planes).sum(axis=1)
    chosen = np.flatnonzero(sharp & (np.bincount(corner, minlength=len(vertices)) >= 3))
    steps = _meeting_points(corner, planes, offset, len(vertices))[chosen]
    ways = np.full(len(vertices), np.inf)
    ways[chosen] = np.linalg.norm(steps, axis=1) / lengths[chosen]
    aims = vertices.copy()
    aims[chosen] += steps
    # Planes of sparse data may meet where there is no surface.
    near = np.zeros(len(vertices), bool)
    near[chosen] = evaluate(aims[chosen])[1] > SUPPORTED
    return _move_in_turn(vertices, aims, np.where(near & (ways < REACH), ways, np.inf), around)


def _move_in_turn(vertices: Array, aims: Array, ways: Array, triangles: NDArray[np.int32]) -> Array:
    """Move vertices of some triangles to their targets, shortest ways first, infinite never."""
    order = np.argsort(ways, kind="stable")
    turn = np.empty(len(vertices), np.int64)
    turn[order] = np.arange(len(vertices))
    waiting = np.isfinite(ways)
    for left in range(ROUNDS, 0, -1):
        moving = waiting
        if left > 1:
            number = np.where(waiting, turn, len(vertices))
            first = number.copy()
            np.minimum.at(first, triangles.ravel(), np.repeat(number[triangles].min(axis=1), 3))
            moving = waiting & (number == first)
        moved = np.where(moving[:, None], aims, vertices)
        vertices = np.asarray(undo_turns(vertices, moved, triangles, TURN))
        waiting = waiting & ~moving
    return vertices


def touching_planes(
    x: Array, length: Array, evaluate: Evaluate
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Find the tangent planes of a function's zero set near queries.

    Parameters
    ----------
    x : (n, 3) float64
        Queries.
    length : (n,) float64
        Length scale at each query.
    evaluate : callable
        As in :func:`sharpen`.

    Returns
    -------
    feet, normals : (n, 3) float64
        A point on each plane, and its unit normal.
    valid : (n,) bool
        True where the function is supported by data and behaves like a distance.
    """
    step = STEP * length
    ahead = x + step[:, None] * np.eye(3)[:, None]
    values, support = evaluate(np.concatenate([x[None], ahead]).reshape(-1, 3))
    values = values.reshape(4, -1)
    gradient = ((values[1:] - values[0]) / step).T
    slope = np.linalg.norm(gradient, axis=1)
    valid = (slope > SLOPE[0]) & (slope < SLOPE[1]) & (support[: len(x)] > SUPPORTED)
    normals = gradient / np.maximum(slope, SLOPE[0])[:, None]
    feet = x - (values[0] / np.maximum(slope, SLOPE[0]))[:, None] * normals
    return feet, normals, valid


def _meeting_points(vertex: NDArray[np.int64], normals: Array, offset: Array, count: int) -> Array:
    """Return the shortest ways of vertices to where their planes meet (least squares)."""
    used, row = np.unique(vertex, return_inverse=True)
    products = np.einsum("ni,nj->nij", normals, normals).reshape(-1, 9)
    matrix = np.stack([np.bincount(row, part) for part in products.T], axis=1)
    right = np.stack([np.bincount(row, part * offset) for part in normals.T], axis=1)
    number = np.bincount(row)[:, None]
    share, axes = np.linalg.eigh((matrix / number).reshape(-1, 3, 3))
    inverse = np.where(share > DISTINCT, 1.0 / np.maximum(share, DISTINCT), 0.0)
    inverse[share[:, 1] <= DISTINCT] = 0.0  # a single direction: no edge
    steps = np.zeros((count, 3))
    steps[used] = np.einsum("nij,nj,nkj,nk->ni", axes, inverse, axes, right / number)
    return steps
