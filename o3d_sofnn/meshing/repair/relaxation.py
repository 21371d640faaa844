"""Vertex relaxation along the surface, for well-shaped triangles, and projection onto it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from o3d_sofnn._kernels import bent_vertices, surroundings, undo_turns
from o3d_sofnn.geometry.mesh_properties import with_corner_in

if TYPE_CHECKING:
    from o3d_sofnn.implicit.field import Evaluate

SHARE = 0.5
"""Fraction of the way to the middle of its neighbours that a vertex moves."""


REACH = 0.25
"""Longest way back to the surface, divided by the mean length of the vertex's edges."""


TURN = 0.5
"""Smallest cosine between the normals of a triangle before and after."""


LOOSE = 0.5
"""Support below which a vertex belongs to a closing, not to the data."""


ROUNDS = 6
"""Number of times that closings are averaged, which removes dents of as many edges."""


Array = NDArray[np.float64]


def relax(
    vertices: Array,
    triangles: NDArray[np.int32],
    evaluate: Evaluate,
) -> tuple[Array, Array]:
    """Improve the shape of the triangles of a closed mesh.

    Every vertex moves towards the middle of its neighbours within its tangent plane, and then along
    its normal to the zero of the function. It moves back if a triangle would flip. Closings of
    holes are smoothed.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A closed mesh.
    evaluate : callable
        Maps (m, 3) queries to (m,) signed distances and (m,) support.

    Returns
    -------
    vertices : (m, 3) float64
    support : (m,) float64
        Support by the data at the vertices, after moving along the surface.
    """
    normals, ways, lengths = map(np.asarray, surroundings(vertices, triangles))
    stepped = vertices + SHARE * ways
    values, support = evaluate(stepped)
    back = np.where(support > 0.0, np.clip(values, -REACH * lengths, REACH * lengths), 0.0)
    stepped -= back[:, None] * normals
    moved = np.asarray(undo_turns(vertices, stepped, triangles, TURN))
    return smooth_closings(moved, triangles, support), support


def smooth_closings(vertices: Array, triangles: NDArray[np.int32], support: Array) -> Array:
    """Smooth the closings of holes, like a membrane fixed at the data.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A closed mesh.
    support : (m,) float64
        Support of the vertices: those without any move most, those on the data do not move.

    Returns
    -------
    (m, 3) float64
    """
    loose = np.flatnonzero(support < LOOSE)
    row = np.full(len(vertices), -1)
    row[loose] = np.arange(len(loose))
    around = triangles[with_corner_in(row >= 0, triangles)]
    ends, following = around.ravel(), around[:, [1, 2, 0]].ravel()
    of_loose = row[ends] >= 0
    count = np.bincount(row[ends[of_loose]], minlength=len(loose))
    mean = scipy.sparse.csr_matrix(
        (
            1.0 / count[row[ends[of_loose]]],
            (row[ends[of_loose]], following[of_loose]),
        ),
        shape=(len(loose), len(vertices)),
    )
    weight = 0.5 * (1.0 - support[loose] / LOOSE)[:, None]
    result = vertices.copy()
    for _ in range(ROUNDS):
        result[loose] += weight * (mean @ result - result[loose])
    return result


SMOOTH = 0.95
"""Cosine between the normals of a vertex and of its triangles above which the surface is smooth:
beside a sharp edge, chords are no evidence of curvature."""


def balance_chords(vertices: Array, triangles: NDArray[np.int32], share: float) -> Array:
    """Move the vertices along their normals until the triangles lie on the surface on average.

    Above a triangle with edges ``d``, the mean height of a quadratic surface with the second
    derivatives ``H`` is ``-sum(d.H.d) / 24``, and ``d.H.d`` is the dot product of the edge and the
    difference of the normals at its ends. With corners ``x`` and normals ``n``, the sum is
    ``3 sum(n.x) - sum(n).sum(x)``.

    Parameters
    ----------
    vertices : (m, 3) float64
        Vertices on the surface.
    triangles : (t, 3) int32
        A closed mesh.
    share : float
        Fraction of the way, 0 to 1.

    Returns
    -------
    (m, 3) float64
        New positions; vertices of triangles beside a sharp edge do not move.
    """
    if share == 0.0:
        return vertices
    normals = np.asarray(surroundings(vertices, triangles)[0])
    bent = np.asarray(bent_vertices(vertices, triangles, normals, SMOOTH)) > 0
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
