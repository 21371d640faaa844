"""Vertices moved along the surface to even out their triangles, and back onto the surface."""

from __future__ import annotations

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from . import _kernels
from .field import Evaluate

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
    normals, ways, lengths = map(np.asarray, _kernels.surroundings(vertices, triangles))
    stepped = vertices + SHARE * ways
    values, support = evaluate(stepped)
    back = np.where(support > 0.0, np.clip(values, -REACH * lengths, REACH * lengths), 0.0)
    stepped -= back[:, None] * normals
    moved = np.asarray(_kernels.undo_turns(vertices, stepped, triangles, TURN))
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
    ends, following = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
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
