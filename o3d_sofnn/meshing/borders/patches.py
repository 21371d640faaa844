"""Patches of a closed mesh that are far from the data, and their rims."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import label_pieces, vertex_normals
from o3d_sofnn.geometry.mesh_properties import triangle_areas

Array = NDArray[np.float64]


Triangles = NDArray[np.int32]


class Patches:
    """Connected patches of loose vertices, and the vertices of their rims.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A closed mesh.
    loose : (m,) bool
        Vertices of patches.

    Attributes
    ----------
    loose : (m,) bool
        As given.
    areas : (m,) float64
        One third of the area of the triangles around each vertex.
    number : (m,) int64
        Number of the patch of each vertex, -1 outside patches.
    count : int
        Number of patches.
    rim, patch : (k,) int64
        Vertices on the data with an edge to a patch, and the patch, once for each such edge.
    normals : (m, 3) float64
        Normals of the vertices, as long as their areas.
    """

    def __init__(self, vertices: Array, triangles: Triangles, loose: NDArray[np.bool_]) -> None:
        self.loose = loose
        corners = np.repeat(triangle_areas(vertices, triangles) / 3.0, 3)
        self.areas = np.bincount(triangles.ravel(), corners, len(vertices))
        at = loose[triangles]
        inner = np.ascontiguousarray(triangles[at.all(axis=1)])
        label = np.asarray(label_pieces(inner, len(vertices)))
        found, of_loose = np.unique(label[loose], return_inverse=True)
        self.count, self.number = len(found), np.full(len(vertices), -1)
        self.number[loose] = of_loose
        self.normals = self.areas[:, None] * np.asarray(vertex_normals(vertices, triangles))
        # Corners on the data, next to a loose one.
        ends, starts = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
        ends, starts = np.concatenate([ends, starts]), np.concatenate([starts, ends])
        across = loose[ends] & ~loose[starts]
        self.patch, self.rim = self.number[ends[across]], starts[across].astype(np.int64)
