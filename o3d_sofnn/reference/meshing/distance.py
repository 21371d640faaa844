"""Distances from a mesh: twin of ``native/meshing/distance.hpp``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def nearest_triangles(
    vertices: Array, triangles: NDArray[np.int32], x: Array
) -> tuple[Array, NDArray[np.int64]]:
    """Find the triangle nearest to every row of `x`: the distance and the row, (n,) each.

    A place is nearest to the triangle where its foot on the plane lies within, or else to one of
    the edges.
    """
    corners = vertices[triangles]
    edges = np.roll(corners, -1, axis=1) - corners
    normal = np.cross(edges[:, 0], edges[:, 1])
    size = np.linalg.norm(normal, axis=1)
    unit = normal / np.maximum(size, 1e-300)[:, None]
    squared_length = np.maximum((edges**2).sum(axis=2), 1e-300)
    distance, nearest = np.full(len(x), np.inf), np.full(len(x), len(triangles))
    for i, place in enumerate(x if len(triangles) else x[:0]):
        way = place - corners
        along = np.clip((way * edges).sum(axis=2) / squared_length, 0.0, 1.0)
        from_edges = np.linalg.norm(way - along[:, :, None] * edges, axis=2).min(axis=1)
        above = ((np.cross(edges, way) * normal[:, None]).sum(axis=2) >= 0.0).all(axis=1)
        height = abs((way[:, 0] * unit).sum(axis=1))
        each = np.where(above & (size > 0.0), height, from_edges)
        nearest[i] = each.argmin()
        distance[i] = each[nearest[i]]
    return distance, nearest
