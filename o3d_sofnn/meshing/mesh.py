"""Stage 9: extraction of the mesh, followed by smoothing, sharpening, closing and decimation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.meshing.borders.closing import EDGE, Closing, Judge
from o3d_sofnn.meshing.borders.rims import tidy
from o3d_sofnn.meshing.borders.trimming import cut, drop_strays, smoothed
from o3d_sofnn.meshing.decimation import decimate
from o3d_sofnn.meshing.isosurface.extraction import extract
from o3d_sofnn.meshing.repair.handles import open_handles
from o3d_sofnn.meshing.repair.relaxation import balance_chords, relax
from o3d_sofnn.meshing.repair.sharpening import sharpen
from o3d_sofnn.meshing.repair.untangling import untangle

if TYPE_CHECKING:
    from o3d_sofnn.implicit.field import Field

FAR = 2.0 * EDGE - 0.45
"""Distance beyond the data, divided by the spacing, at which distances are clipped. Averaging then
leaves a straight border in its place, as samples are 0.45 spacings from places between them."""


def mesh(
    implicit: Field,
    samples: NDArray[np.float64],
    size: float,
    levels: NDArray[np.int64],
    border: Judge | float | None,
    target: int | None,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64], Closing | None]:
    """Triangulate a field, and trim and decimate the mesh as the user wants.

    Parameters
    ----------
    implicit : Field
        The function.
    samples : (n, 3) float64
        Points moved onto the surface.
    size, levels
        As in :func:`extract`.
    border : Judge or float or None
        A judge that decides where the surface ends, or the confidence at which it ends; None for a
        closed surface.
    target : int or None
        Number of triangles to keep; None keeps all.

    Returns
    -------
    vertices : (v, 3) float64
    triangles : (t, 3) int32
    confidence : (v,) float64
        Support by the data.
    closing : Closing or None
        The decision, if there is a judge.

    Raises
    ------
    ValueError
        No triangle is left.
    """
    vertices, triangles = extract(implicit, samples, size, levels)
    if len(triangles):
        triangles, used = drop_strays(vertices, triangles, samples)
        vertices = vertices[used]
    relaxed, confidence = relax(vertices, triangles, implicit)
    moved = sharpen(relaxed, triangles, implicit)
    # Roughness caused by noise is not curvature.
    moved = balance_chords(moved, triangles, 1.0 - implicit.noisiness)
    vertices = untangle([vertices, relaxed, moved], triangles)
    vertices, triangles, source = open_handles(vertices, triangles, implicit.spacing_at)
    confidence = confidence[source]
    closing = None
    values, level = None, 0.0
    if isinstance(border, Judge):
        beyond, closing = border(vertices, triangles)
        if not closing.closed:
            values, level = -np.minimum(beyond, FAR), -EDGE
    elif border is not None:
        values, level = confidence, border
    if values is not None:
        values = smoothed(values, level, vertices, triangles, implicit.spacing_at(vertices))
        vertices, triangles, confidence = cut(vertices, triangles, confidence, values, level)[:3]
        triangles, used = drop_strays(vertices, triangles, samples)
        vertices, confidence = vertices[used], confidence[used]
        vertices, triangles, used = tidy(vertices, triangles, implicit.spacing_at(vertices))
        confidence = confidence[used]
    if not len(triangles):
        reason = "the points are too few or too flat" if border is None else "no data supports it"
        raise ValueError(f"points define no surface at this resolution: {reason}")
    if target is not None:
        vertices, triangles, source = decimate(vertices, triangles, target)
        confidence = confidence[source]
    return vertices, triangles, confidence, closing
