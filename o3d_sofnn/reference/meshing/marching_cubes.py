"""Triangles of the zero set: twin of ``native/meshing/marching_cubes.hpp``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def marching_cubes(
    values: NDArray[np.float64],
    nodes: NDArray[np.float64],
    cubes: NDArray[np.int32],
    triangles: NDArray[np.int64],
    members: NDArray[np.int64],
    ends: NDArray[np.int64],
    nudges: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]:
    """Triangulate the zero set on a list of cubes.

    Parameters
    ----------
    values : (m,) float64
        Field at the nodes, negative inside.
    nodes : (m, 3) float64
        Positions of the nodes.
    cubes : (c, 8) int32
        Nodes of each cube; neighbouring corners may coincide.
    triangles : (2, 256, t, 3) int64
        Vertices of the triangles of each case, for cubes with different corners and for others: 0
        to 11 on the edges, 12 to 15 in the middle of a loop, -1 for none.
    members : (2, 256, 4, 12) int64
        Edges of the loop around each middle, -1 for none.
    ends : (12, 2) int64
        Corners of each edge.
    nudges : (2,) float64
        Least distance of a vertex from a node, over the edge; and that of the second places.

    Returns
    -------
    vertices : (v, 3) float64
        In the order in which the cubes need them.
    triangles : (f, 3) int32
        Cube by cube.
    uneven : (k,) int32
        Vertices beside cubes with corners that coincide,
    inner : (k, 3) float64
        and their second places.
    """
    # An edge is named by its nodes, the lower one first, and a middle by its cube and number.
    n = len(values)
    edge = cubes[:, ends].astype(np.int64)
    fan = (edge[:, :, 0] == edge[:, :, 1]).any(axis=1).astype(np.int64)
    edge_key = edge.min(axis=2) * n + edge.max(axis=2)
    at_level_change = np.unique(edge_key[fan > 0])

    def crossings(keys: NDArray[np.int64], second: bool) -> NDArray[np.float64]:
        start, end = np.divmod(keys, n)
        fall = values[start] - values[end]
        nudge = nudges[(np.isin(keys, at_level_change) & second).astype(np.int64)]
        t = np.fmax(nudge, values[start] / np.where(fall == 0.0, 1.0, fall))
        t = np.minimum(1.0 - nudge, t)[:, None]  # what is no number becomes the nudge
        return np.asarray(nodes[start] + t * (nodes[end] - nodes[start]))

    case = (values < 0)[cubes] @ (1 << np.arange(8))
    crossed = (case > 0) & (case < 255)
    cubes, case, fan, edge_key = cubes[crossed], case[crossed], fan[crossed], edge_key[crossed]
    middle_key = n**2 + 4 * np.arange(len(cubes))[:, None] + np.arange(4)
    key = np.concatenate([edge_key, middle_key], axis=1)
    local = triangles[fan, case]
    cube, slot = np.nonzero(local[:, :, 0] >= 0)
    named = key[cube[:, None], local[cube, slot]]
    named = named[_proper(named, fan[cube] > 0, n**2)]
    used, first, back = np.unique(named, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.argsort(order)

    places = np.zeros((2, len(used), 3))
    on_edge = used < n**2
    owner, number = np.divmod(used[~on_edge] - n**2, 4)
    loop = members[fan[owner], case[owner], number]
    around = edge_key[owner[:, None], np.maximum(loop, 0)]
    weight = (loop >= 0).astype(np.float64)[:, :, None]
    for second in (False, True):
        places[int(second), on_edge] = crossings(used[on_edge], second)
        points = crossings(around.ravel(), second).reshape(*loop.shape, 3)
        summed = np.where(weight > 0.0, points, 0.0).sum(axis=1)
        places[int(second), ~on_edge] = summed / weight.sum(axis=1)
    vertices, inner = places[:, order]
    uneven = np.flatnonzero((inner != vertices).any(axis=1)).astype(np.int32)
    return vertices, rank[back].reshape(-1, 3).astype(np.int32), uneven, inner[uneven]


def _proper(
    keys: NDArray[np.int64], fan: NDArray[np.bool_], first_middle: int
) -> NDArray[np.bool_]:
    """Triangles that have not collapsed, without fans of which less than three are left."""
    whole = (keys != np.roll(keys, 1, axis=1)).all(axis=1)
    _, back = np.unique(keys[:, 0], return_inverse=True)
    left = np.bincount(back, whole)[back]
    return np.asarray(~fan | (whole & ((keys[:, 0] < first_middle) | (left >= 3))))
