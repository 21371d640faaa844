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
    areas : (m,) float64
        One third of the area of the triangles around each vertex.
    label : (m,) int64
        Number of the patch of each vertex; vertices outside patches have numbers of their own.
    """

    def __init__(self, vertices: Array, triangles: Triangles, loose: NDArray[np.bool_]) -> None:
        self.loose = loose
        corners = np.repeat(triangle_areas(vertices, triangles) / 3.0, 3)
        self.areas = np.bincount(triangles.ravel(), corners, len(vertices))
        at = loose[triangles]
        inner = np.ascontiguousarray(triangles[at.all(axis=1)])
        self.label = np.asarray(label_pieces(inner, len(vertices)))
        self._normals = self.areas[:, None] * np.asarray(vertex_normals(vertices, triangles))
        # Corners on the data, next to a loose one.
        ends, starts = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
        ends, starts = np.concatenate([ends, starts]), np.concatenate([starts, ends])
        across = loose[ends] & ~loose[starts]
        self._patch, self._rim = self.label[ends[across]], starts[across]

    def largest(self, values: Array) -> Array:
        """Return the largest of the vertices' values, (m,), on each patch, (p,)."""
        found = np.zeros(int(self.label.max(initial=-1)) + 1)
        np.maximum.at(found, self.label[self.loose], values[self.loose])
        return found

    def on_rim(self, values: Array) -> Array:
        """Return the mean of the vertices' values, (m,), along the rim of each patch, (p,)."""
        n = int(self.label.max(initial=-1)) + 1
        count = np.bincount(self._patch, minlength=n)
        return np.bincount(self._patch, values[self._rim], n) / np.maximum(count, 1)

    def facing(self, normals: Array) -> Array:
        """Return the mean cosine, (p,), between normals along the rim and of the whole patch."""
        n, rows = int(self.label.max(initial=-1)) + 1, self.label[self.loose]
        own = self._normals[self.loose]
        whole = np.stack([np.bincount(rows, own[:, d], n) for d in range(3)], axis=1)
        rim = np.stack([self.on_rim(normals[:, d]) for d in range(3)], axis=1)
        length = np.maximum(np.linalg.norm(whole, axis=1), 1e-300)
        return np.asarray(np.einsum("pd,pd->p", rim, whole) / length)
