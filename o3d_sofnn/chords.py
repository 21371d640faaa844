"""Vertices moved off a bent surface by as much as the triangles between them cut it short.

With all vertices on the surface its triangles lie inside of it where it is convex, by an eighth of
the curvature times the square of an edge in the middle of that. Half-way between, the error is a
third, and the volume is kept.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import _kernels

SMOOTH = 0.95
"""Cosine between the normals of a vertex and of its triangles from which on the surface is smooth:
beside an edge chords say nothing about curvature."""

Array = NDArray[np.float64]


def balance_chords(vertices: Array, triangles: NDArray[np.int32], share: float) -> Array:
    """Move the vertices along their normals until the triangles lie on the surface in the mean.

    Over a triangle with edges ``d`` a quadratic surface is off the plane through the corners by
    ``-sum(d.H.d) / 24`` in the mean, with its second derivatives ``H``, and ``d.H.d`` is the
    product of the edge with the difference of the normals at its ends.

    Parameters
    ----------
    vertices : (m, 3) float64
        On the surface.
    triangles : (t, 3) int32
        A closed mesh.
    share : float
        Part of the way, 0 to 1.

    Returns
    -------
    (m, 3) float64
        Vertices of triangles beside a sharp edge stay.
    """
    normals = np.asarray(_kernels.surroundings(vertices, triangles)[0])
    bent = np.asarray(_kernels.bent_vertices(vertices, triangles, normals, SMOOTH)) > 0
    corners, facing = vertices[triangles], normals[triangles]
    edges = np.roll(corners, -1, axis=1) - corners
    turns = np.roll(facing, -1, axis=1) - facing
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    off = np.where(bent[triangles].any(axis=1), 0.0, (turns * edges).sum(axis=(1, 2)) / 24.0)
    ends, count = triangles.ravel(), len(vertices)
    total = np.bincount(ends, np.repeat(area, 3), count)
    mean = np.bincount(ends, np.repeat(area * off, 3), count) / np.where(total > 0.0, total, 1.0)
    return np.asarray(vertices + share * np.where(bent, 0.0, mean)[:, None] * normals)
