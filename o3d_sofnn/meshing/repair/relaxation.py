"""Vertices moved along the surface to even out their triangles, and back onto the surface."""

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
"""Part of the way to the middle of its neighbours that a vertex goes."""


REACH = 0.25
"""Longest way back to the surface, over the mean length of the edges of a vertex."""


TURN = 0.5
"""Least cosine between the normals of a triangle before and after."""


LOOSE = 0.5
"""Support below which a vertex belongs to a closing and not to the data."""


ROUNDS = 6
"""Times that closings are averaged: a dent of as many edges goes."""


Array = NDArray[np.float64]


def relax(
    vertices: Array,
    triangles: NDArray[np.int32],
    evaluate: Evaluate,
) -> tuple[Array, Array]:
    """Even out the triangles of a closed mesh.

    Every vertex goes towards the middle of its neighbours, in its tangential plane only, and then
    along its normal to the zero of the function. A vertex goes back where a triangle would turn.
    What closes holes is smoothed.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A closed mesh.
    evaluate : callable
        (m, 3) places to (m,) signed distances and (m,) support.

    Returns
    -------
    vertices : (m, 3) float64
    support : (m,) float64
        Where the vertices went along the surface.
    """
    normals, ways, lengths = map(np.asarray, surroundings(vertices, triangles))
    stepped = vertices + SHARE * ways
    values, support = evaluate(stepped)
    back = np.where(support > 0.0, np.clip(values, -REACH * lengths, REACH * lengths), 0.0)
    stepped -= back[:, None] * normals
    moved = np.asarray(undo_turns(vertices, stepped, triangles, TURN))
    return smooth_closings(moved, triangles, support), support


def smooth_closings(vertices: Array, triangles: NDArray[np.int32], support: Array) -> Array:
    """Smooth what closes holes, like a membrane that the data holds.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A closed mesh.
    support : (m,) float64
        Vertices without any move most, those on the data stay.

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
"""Cosine between the normals of a vertex and of its triangles from which on the surface is smooth:
beside an edge chords say nothing about curvature."""


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
