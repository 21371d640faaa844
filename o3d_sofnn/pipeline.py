"""The method from top to bottom: two operators on arrays. Each stage is a call to its own file."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from o3d_sofnn._kernels import vertex_normals
from o3d_sofnn.algorithm1 import Learned, infer, learn_rules
from o3d_sofnn.algorithm2 import implicit_function, triangulate
from o3d_sofnn.geometry.checks import check_stage
from o3d_sofnn.geometry.quality import Inliers, assess
from o3d_sofnn.meshing.attributes import attribute_weights
from o3d_sofnn.meshing.decimation import unmet
from o3d_sofnn.options import Options
from o3d_sofnn.progress import STAGES, Clock, ProgressCallback
from o3d_sofnn.results import NormalEstimate, SurfaceEstimate
from o3d_sofnn.rules.inference import infer_normals
from o3d_sofnn.rules.trust import shipped
from o3d_sofnn.threads import using_threads

__all__ = ["STAGES", "NormalEstimate", "SurfaceEstimate", "estimate_normals", "reconstruct_surface"]

Array = NDArray[np.float64]


def estimate_normals(
    points: Array,
    options: Options | None = None,
    *,
    progress: ProgressCallback | None = None,
    **fields: Any,
) -> NormalEstimate:
    """Estimate oriented normals (Algorithm 1).

    Parameters
    ----------
    points : (n, 3) float64
        Finite, at least 4, in any unit.
    options : Options, optional
        What the user has chosen.
    progress : callable, optional
        Called with the fraction done and the name of the stage that begins.
    **fields
        Attributes of :class:`Options` by name; they override those of `options`.

    Returns
    -------
    NormalEstimate

    Raises
    ------
    ValueError
        `points` has fewer than 4 rows, or they are all equal or on one line.
    """
    options = replace(options or Options(), **fields)
    clock = Clock(progress)
    with using_threads(options.n_threads):
        learned = learn_rules(points, options, clock, experience=shipped())
        estimate = _facing(points, infer(learned, options, clock)[0])
        clock.finish()
    return estimate


def reconstruct_surface(
    points: Array,
    options: Options | None = None,
    *,
    normals: Array | None = None,
    progress: ProgressCallback | None = None,
    **fields: Any,
) -> SurfaceEstimate:
    """Reconstruct a surface (Algorithms 1 and 2).

    Parameters
    ----------
    points : (n, 3) float64
        Finite, at least 4, in any unit.
    options : Options, optional
        What the user has chosen.
    normals : (n, 3) float64, optional
        Known normals: the surface faces the same sides. None finds the sides from the points. They
        cannot be combined with a viewpoint or a direction in `options`.
    progress : callable, optional
        Called with the fraction done and the name of the stage that begins.
    **fields
        Attributes of :class:`Options` by name; they override those of `options`.

    Returns
    -------
    SurfaceEstimate

    Raises
    ------
    ValueError
        `points` has fewer than 4 rows, or they are all equal, on one line, or (without `trim`) in
        one plane; `voxel_size` asks for more than 500,000 cubes along one side.
    """
    options = replace(options or Options(), **fields)
    clock = Clock(progress)
    with using_threads(options.n_threads):
        learned = learn_rules(
            points,
            options,
            clock,
            normals=normals,
            experience=shipped(),
            enclosing=options.closes is True,
        )
        estimate, facing, residual = infer(learned, options, clock)  # Eq. (7), (9)
        function = implicit_function(learned, facing, residual, options, clock)  # Algorithm 2
        cloud, asked = learned.cloud, _asked(points, estimate, learned, function.spacing)
        del learned, facing, residual  # a third of the memory in use
        meshed = triangulate(function, options, clock)  # section 4
        rules, size, offset_points = function.rules, function.size, function.offset_points
        del function
        vertices, triangles, confidence = meshed.vertices, meshed.triangles, meshed.confidence
        with clock.stage("attributes"):
            facing = np.asarray(vertex_normals(vertices, triangles))
            near = np.flatnonzero(confidence > 0.0)
            facing[near] = infer_normals(rules, vertices[near])[0]
            check_stage("attributes", normals=facing, confidences=confidence)
            quality = assess(vertices, triangles, meshed.beyond, asked)
        clock.finish()
    warnings = estimate.warnings + unmet(options.target_triangles, len(triangles))
    return SurfaceEstimate(
        vertices=vertices * cloud.extent + cloud.middle,
        triangles=triangles,
        vertex_normals=facing,
        confidence=confidence,
        weigh=partial(_weigh, options.n_threads, vertices, cloud.points, cloud.inverse, size),
        normals=_facing(points, replace(estimate, warnings=warnings)),
        offset_points=offset_points,
        voxel_size=options.voxel_size or size * cloud.extent,
        seconds=clock.seconds,
        watertight=meshed.watertight,
        closing=meshed.closing,
        quality=replace(quality, border_length=quality.border_length * cloud.extent),
    )


def _asked(points: Array, estimate: NormalEstimate, learned: Learned, spacing: Array) -> Inliers:
    """Return the sample of the inliers that the mesh is checked against."""
    cloud, kept = learned.cloud, learned.samples.kept
    rows = cloud.first[kept]
    directions = learned.evidence.directions(points)
    return Inliers.some(
        cloud.points[kept],
        np.maximum(spacing, 2.0 * estimate.noise[rows] / cloud.extent),
        None if directions is None else directions[rows],
    )


def _weigh(n_threads: int, *places: Any) -> scipy.sparse.csr_matrix:
    """Compute the weights of attributes when they are asked for, after the call has ended."""
    with using_threads(n_threads):
        return attribute_weights(*places)


def _facing(points: Array, estimate: NormalEstimate) -> NormalEstimate:
    """Turn every normal towards the place its point was seen from, if that is known."""
    return replace(estimate, normals=estimate.evidence.turned(points, estimate.normals))
