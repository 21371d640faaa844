"""Arrays of a MeshLab layer in, arrays of a MeshLab layer out: the only caller of o3d_sofnn.

Both the Python filters and the native plugin end here, so that they cannot differ.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import pipeline, validation
from o3d_sofnn.options import Options

Progress = Callable[[float, str], None]

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Cloud:
    """The points of a layer in world coordinates.

    Attributes
    ----------
    points : (n, 3) float64
    normals : (n, 3) float64 or None
        None unless they are to be used.
    colors : (n, 4) uint8 or None
        RGBA; None for a layer without colours.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64] | None = None
    colors: NDArray[np.uint8] | None = None


@dataclass(frozen=True)
class Surface:
    """A new layer; its matrix is the identity.

    Attributes
    ----------
    vertices, normals : (m, 3) float64
    triangles : (f, 3) int32
    confidence : (m,) float64
        In [0, 1]; goes into MeshLab's vertex scalar ("quality").
    colors : (m, 4) uint8 or None
    summary : dict
        Numbers for the dictionary that a filter returns.
    """

    vertices: NDArray[np.float64]
    normals: NDArray[np.float64]
    triangles: NDArray[np.int32]
    confidence: NDArray[np.float64]
    colors: NDArray[np.uint8] | None
    summary: dict[str, Any]


def given_colors(colors: NDArray[np.uint8]) -> NDArray[np.uint8] | None:
    """Return the colours of a layer, or None: MeshLab's vertices are white until they get one."""
    return colors if (colors != 255).any() else None


def surface_of_cloud(
    cloud: Cloud, options: Mapping[str, Any], progress: Progress | None = None
) -> Surface:
    """Reconstruct the surface of a cloud.

    Parameters
    ----------
    cloud : Cloud
        Points that are not finite are left out and counted in the summary.
    options : mapping
        Attributes of :class:`o3d_sofnn.options.Options` by name, and ``use_normals``.
    progress : callable, optional
        Called with the fraction done and the stage.

    Returns
    -------
    Surface

    Raises
    ------
    ValueError
        Bad points or options; also normals that are to be used and are missing.
    """
    chosen = dict(options)
    use_normals = chosen.pop("use_normals")
    checked = Options.checked(len(cloud.points), use_normals=use_normals, **chosen)
    kept, points = _finite_points(cloud)
    normals = _own_normals(cloud.normals, kept) if use_normals else None
    estimate = pipeline.reconstruct_surface(points, checked, normals=normals, progress=progress)
    colors = None
    if cloud.colors is not None:
        mixed = estimate.source_weights @ cloud.colors[kept].astype(np.float64)
        colors = np.clip(np.rint(mixed), 0, 255).astype(np.uint8)
    summary = {
        **_summary(estimate.normals, estimate.warnings, len(kept) - len(points)),
        "voxel_size": float(estimate.voxel_size),
        "offset_points": int(estimate.offset_points),
        "watertight": bool(estimate.watertight),
        "seconds": float(sum(estimate.seconds.values())),
    }
    return Surface(
        vertices=estimate.vertices,
        normals=estimate.vertex_normals,
        triangles=estimate.triangles,
        confidence=estimate.confidence,
        colors=colors,
        summary=summary,
    )


def normals_of_cloud(
    cloud: Cloud, options: Mapping[str, Any], progress: Progress | None = None
) -> tuple[NDArray[np.float64], dict[str, Any]]:
    """Estimate an oriented normal at every point of a cloud.

    Parameters
    ----------
    cloud : Cloud
        Points that are not finite get the normal (0, 0, 0) and are counted in the summary.
    options : mapping
        Attributes of :class:`o3d_sofnn.options.Options` by name.
    progress : callable, optional
        Called with the fraction done and the stage.

    Returns
    -------
    (n, 3) float64, dict
        Unit normals in world coordinates, and numbers for the filter's result dictionary.

    Raises
    ------
    ValueError
        Bad points or options.
    """
    checked = Options.checked(len(cloud.points), **options)
    kept, points = _finite_points(cloud)
    estimate = pipeline.estimate_normals(points, checked, progress=progress)
    normals = np.zeros_like(cloud.points)
    normals[kept] = estimate.normals
    ignored = len(kept) - len(points)
    summary = {
        **_summary(estimate, estimate.warnings, ignored),
        "seconds": float(sum(estimate.seconds.values())),
    }
    return normals, summary


def _finite_points(cloud: Cloud) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    kept = validation.finite_rows(cloud.points)
    points = cloud.points if kept.all() else cloud.points[kept]
    return kept, validation.check_points(points)


def _own_normals(
    normals: NDArray[np.float64] | None, kept: NDArray[np.bool_]
) -> NDArray[np.float64]:
    if normals is None:
        raise ValueError("use_normals: expected a layer with vertex normals, got none")
    normals = normals[kept]
    # MeshLab gives every new vertex the normal (0, 0, 0).
    missing = int(np.count_nonzero(~normals.any(axis=1)))
    if missing:
        raise ValueError(
            f"use_normals: expected a normal at every vertex, got {missing} of {len(normals)} "
            "vertices without; compute normals first or leave use_normals off"
        )
    return normals


def _summary(estimate: Any, warnings: tuple[str, ...], ignored: int) -> dict[str, Any]:
    for warning in warnings:
        _log.warning("%s", warning)
    return {
        "noise_level": float(estimate.noise_level),
        "spacing": float(estimate.spacing),
        "outliers": int(np.count_nonzero(estimate.outliers)),
        "ignored_points": ignored,
    }
