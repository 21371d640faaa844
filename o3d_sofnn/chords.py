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
    product of the edge with the difference of the normals at its ends. With corners ``x`` and
    normals ``n`` the sum is ``3 sum(n.x) - sum(n).sum(x)``.

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
    if share == 0.0:
        return vertices
    normals = np.asarray(_kernels.surroundings(vertices, triangles)[0])
    bent = np.asarray(_kernels.bent_vertices(vertices, triangles, normals, SMOOTH)) > 0
    ends = triangles.ravel()
    own = np.einsum("md,md->m", normals, vertices)[ends].reshape(-1, 3).sum(axis=1)
    facing, middle = (
        x[triangles[:, 0]] + x[triangles[:, 1]] + x[triangles[:, 2]] for x in (normals, vertices)
    )
    off = (3.0 * own - np.einsum("td,td->t", facing, middle)) / 24.0
    off[bent[ends].reshape(-1, 3).any(axis=1)] = 0.0
    number = np.bincount(ends, minlength=len(vertices))
    way = share * np.bincount(ends, np.repeat(off, 3), len(vertices)) / np.maximum(number, 1)
    way[bent] = 0.0
    return np.asarray(vertices + way[:, None] * normals)
