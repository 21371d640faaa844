"""No intersecting triangles: vertex moves that cause intersections are undone.

The first mesh must be free of intersections, as marching cubes makes it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import intersecting_pairs
from o3d_sofnn.geometry.mesh_properties import with_corner_in
from o3d_sofnn.threads import thread_count

Array = NDArray[np.float64]


Triangles = NDArray[np.int32]


def untangle(steps: Sequence[Array], triangles: Triangles) -> Array:
    """Undo moves until no triangle intersects, touches or covers another one.

    Of the corners of two triangles that do so, the one that moved farthest in the last step that
    moved any of them returns to its position before that step.

    Parameters
    ----------
    steps : sequence of (m, 3) float64
        Positions of the vertices: initially, without intersections, and after each step.
    triangles : (t, 3) int32
        Triangles; shared vertices and edges do not count as intersections.

    Returns
    -------
    (m, 3) float64
        Positions after the last step, except for vertices whose moves were undone.
    """
    vertices = steps[-1].copy()
    stage = np.full(len(vertices), len(steps) - 1)
    suspect = with_corner_in((vertices != steps[0]).any(axis=1), triangles)
    way = np.zeros(len(vertices))
    while suspect.any():
        pairs = np.asarray(intersecting_pairs(vertices, triangles, suspect, thread_count()))
        corners = triangles[pairs].reshape(-1, 6)
        used = np.unique(corners)
        way[used] = 0.0
        for number in range(len(steps) - 1, 0, -1):
            own = used[stage[used] == number]
            way[own] = np.linalg.norm(vertices[own] - steps[number - 1][own], axis=1)
            stage[own[way[own] == 0.0]] -= 1  # it did not move in this step
        last = stage[corners] == stage[corners].max(axis=1, keepdims=True)
        farthest = np.where(last, way[corners], -1.0).argmax(axis=1)[:, None]
        back = np.unique(np.take_along_axis(corners, farthest, axis=1))
        back = back[stage[back] > 0]
        for number in range(1, len(steps)):
            own = back[stage[back] == number]
            vertices[own] = steps[number - 1][own]
            stage[own] -= 1
        went = np.zeros(len(vertices), bool)
        went[back] = True
        suspect = with_corner_in(went, triangles)
    return vertices
