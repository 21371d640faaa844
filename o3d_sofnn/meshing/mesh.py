"""Stage 9: sparse isosurface. Cubes with data and those the surface leads to until it closes."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.implicit.field import Field
from o3d_sofnn.meshing.decimation import decimate
from o3d_sofnn.meshing.extraction import extract
from o3d_sofnn.meshing.handles import open_handles
from o3d_sofnn.meshing.relaxation import balance_chords, relax
from o3d_sofnn.meshing.sharpening import sharpen
from o3d_sofnn.meshing.trimming import cut, drop_strays
from o3d_sofnn.meshing.untangling import untangle


def mesh(
    implicit: Field,
    samples: NDArray[np.float64],
    size: float,
    levels: NDArray[np.int64],
    trim: float | Literal["auto"] | None,
    target: int | None,
    n_threads: int,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64]]:
    """Triangulate a field, and do to the triangles what the user wants.

    Parameters
    ----------
    implicit : Field
        The function.
    samples : (n, 3) float64
        Points moved onto the surface.
    size, levels
        As in :func:`extract`.
    trim : float or "auto" or None
        Where to cut (:func:`o3d_sofnn.meshing.trimming.cut`); None for nowhere.
    target : int or None
        Triangles to be left, or as few as can be.
    n_threads : int
        Threads.

    Returns
    -------
    vertices : (v, 3) float64
    triangles : (t, 3) int32
    confidence : (v,) float64
        Support by the data.

    Raises
    ------
    ValueError
        No triangle is left.
    """
    vertices, triangles = extract(implicit, samples, size, levels, n_threads)
    if len(triangles):
        triangles, used = drop_strays(vertices, triangles, samples, n_threads)
        vertices = vertices[used]
    relaxed, confidence = relax(vertices, triangles, implicit)
    moved = sharpen(relaxed, triangles, implicit)
    # What noise leaves of roughness is no curvature.
    moved = balance_chords(moved, triangles, 1.0 - implicit.noisiness)
    vertices = untangle([vertices, relaxed, moved], triangles, n_threads)
    vertices, triangles, source = open_handles(vertices, triangles, implicit.spacing_at, n_threads)
    confidence = confidence[source]
    if trim is not None:
        vertices, triangles, confidence = cut(vertices, triangles, confidence, trim)
        triangles, used = drop_strays(vertices, triangles, samples, n_threads)
        vertices, confidence = vertices[used], confidence[used]
    if not len(triangles):
        reason = "the points are too few or too flat" if trim is None else "trim removed it all"
        raise ValueError(f"points define no surface at this resolution: {reason}")
    if target is not None:
        vertices, triangles, source = decimate(vertices, triangles, target, n_threads)
        confidence = confidence[source]
    return vertices, triangles, confidence
