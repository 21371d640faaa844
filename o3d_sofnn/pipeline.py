"""The two operators on arrays: a call a stage, a file behind each; stages 1 to 5 in `learning`."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from . import metrics
from ._kernels import KdTree, vertex_normals
from .attributes import attribute_weights
from .clock import STAGES, Clock, Progress
from .experience import shipped
from .field import Field
from .learning import Learned, learn_rules
from .resolution import choose_cubes
from .results import NormalEstimate, SurfaceEstimate
from .rlps import local_surfaces
from .rules import infer_normals
from .surface import mesh
from .validation import affine_rank, thread_count
from .winding import leaned, turned_to

__all__ = ["STAGES", "NormalEstimate", "SurfaceEstimate", "estimate_normals", "reconstruct_surface"]

Array = NDArray[np.float64]


def estimate_normals(
    points: Array,
    *,
    max_nn: int | None = None,
    radius: float | None = None,
    viewpoint: Array | None = None,
    towards: Array | None = None,
    n_threads: int = -1,
    progress: Progress | None = None,
) -> NormalEstimate:
    """Estimate oriented normals (stages 1 to 6).

    Parameters
    ----------
    points : (n, 3) float64
        Finite, at least 4, in any unit.
    max_nn : int, optional
        Largest number of points in a local fit. None chooses from the data.
    radius : float, optional
        Largest radius of a local fit, in the unit of the points.
    viewpoint : (3,) or (n, 3) float64, optional
        A place that all normals face, or one for each point.
    towards : (3,) float64, optional
        A direction that the normals of each separate piece shall face in the mean.
    n_threads : int, default -1
        Threads; -1 for one a core. The result does not depend on it.
    progress : callable, optional
        Called with the fraction done and the name of the stage that begins.

    Returns
    -------
    NormalEstimate

    Raises
    ------
    ValueError
        `points` has fewer than 4 rows, or they are all equal or on one line.
    """
    threads = thread_count(n_threads)
    clock = Clock(progress)
    learned = learn_rules(
        points, None, max_nn, radius, viewpoint, towards, threads, clock, shipped()
    )
    estimate = _facing(viewpoint, points, _infer(learned, threads, clock)[0])
    clock.finish()
    return estimate


def reconstruct_surface(
    points: Array,
    *,
    normals: Array | None = None,
    viewpoint: Array | None = None,
    towards: Array | None = None,
    depth: int | None = None,
    voxel_size: float | None = None,
    trim: float | Literal["auto"] | None = None,
    target_triangles: int | None = None,
    precision: float | None = None,
    max_nn: int | None = None,
    radius: float | None = None,
    n_threads: int = -1,
    progress: Progress | None = None,
) -> SurfaceEstimate:
    """Reconstruct a closed surface (stages 1 to 9).

    Parameters
    ----------
    points : (n, 3) float64
        Finite, at least 4, in any unit.
    normals : (n, 3) float64, optional
        Known sides: the surface faces them. None finds the sides from the points. At most one of
        `normals`, `viewpoint` and `towards`.
    viewpoint, towards
        As in :func:`estimate_normals`: the surface faces the place, or its pieces the direction.
    depth : int, optional
        The longest side of the bounding box, that of the outliers left out, is divided into
        ``2**depth`` cubes.
    voxel_size : float, optional
        Edge of a cube, in the unit of the points. Without `depth` and `voxel_size` it is chosen
        from spacing and noise.
    trim : float or "auto", optional
        Cut away what has a confidence below this, 0 to 1; the mesh is then open. "auto" cuts at
        0.5 and leaves holes closed that are small beside the data (:func:`trimming.cut`).
    target_triangles : int, optional
        Collapse edges until so many are left (:func:`decimation.decimate`). None keeps all.
    precision : float, optional
        Largest residual that the local surfaces shall leave (epsilon of Algorithm 2), in the unit
        of the points. None takes it from noise and size.
    max_nn, radius, n_threads, progress
        As in :func:`estimate_normals`.

    Returns
    -------
    SurfaceEstimate

    Raises
    ------
    ValueError
        `points` has fewer than 4 rows, or they are all equal, on one line, or (without `trim`) in
        one plane; `voxel_size` asks for more than 500,000 cubes along one side.
    """
    threads = thread_count(n_threads)
    clock = Clock(progress)
    if trim is None and affine_rank(points) == 2:
        raise ValueError("points lie in one plane and enclose nothing: give trim to get a sheet")
    learned = learn_rules(
        points, normals, max_nn, radius, viewpoint, towards, threads, clock, shipped()
    )
    estimate, facing, residual = _infer(learned, threads, clock)
    rules = learned.rules

    with clock.stage("local surfaces"):
        inliers = learned.points
        if not learned.inliers.all():
            inliers = inliers[learned.inliers]
            facing, residual = facing[learned.inliers], residual[learned.inliers]
        limit = None if precision is None else precision / learned.extent
        rules, surfaces = local_surfaces(rules, inliers, facing, learned.tree, threads, limit)
        distinct, inverse, scale = learned.points, learned.inverse, learned.scale
        middle, extent = learned.middle, learned.extent
        del learned  # with its tree
    with clock.stage("field"):
        samples = inliers - residual[:, None] * facing
        spacing = scale.spacing[scale.at(inliers, threads)]
        usual = float(np.median(scale.spacing))
        wanted = None if voxel_size is None else voxel_size / extent
        size, finest, levels = choose_cubes(
            inliers, samples, spacing, usual, rules, depth, wanted, threads
        )
        spacing = np.maximum(spacing, finest * np.exp2(levels))
        implicit = Field(rules, surfaces, samples, facing, spacing, threads)
    del inliers, facing, residual, spacing  # a third of what is held
    with clock.stage("surface"):
        vertices, triangles, confidence = mesh(
            implicit, samples, finest, levels, trim, target_triangles, threads
        )
    del implicit, samples
    with clock.stage("attributes"):
        facing = np.asarray(vertex_normals(vertices, triangles))
        near = np.flatnonzero(confidence > 0.0)
        facing[near] = infer_normals(rules, vertices[near], threads)[0]
    clock.finish()
    return SurfaceEstimate(
        vertices=vertices * extent + middle,
        triangles=triangles,
        vertex_normals=facing,
        confidence=confidence,
        weigh=partial(attribute_weights, vertices, distinct, inverse, size, threads),
        normals=_facing(viewpoint, points, estimate),
        offset_points=surfaces.offset_points,
        voxel_size=voxel_size or size * extent,
        seconds=clock.seconds,
        watertight=metrics.is_closed(triangles),
    )


def _infer(learned: Learned, threads: int, clock: Clock) -> tuple[NormalEstimate, Array, Array]:
    """Stage 6: a normal at every point, outliers and duplicates included.

    Beside the estimate, normals and residuals of the distinct points.
    """
    with clock.stage("inference"):
        rules = learned.rules
        sides = np.zeros_like(learned.points)
        sides[learned.inliers] = learned.sides
        normals, agreement, residual = infer_normals(
            rules, learned.points, threads, sides=sides, experience=shipped()
        )
        nearest = KdTree(rules.feet, threads).query(learned.points, 1, np.inf, threads)[1][:, 0]
        confidence = agreement * rules.confidence[nearest]
        noise = rules.noise[nearest]
        spacing = float(np.median(learned.scale.spacing))
        doubt = (1.0 - confidence) * np.minimum(1.0, 2.0 * noise / spacing)
        leaning = leaned(normals, sides, doubt)
    back = learned.inverse
    estimate = NormalEstimate(
        normals=leaning[back],
        confidence=confidence[back],
        outliers=~learned.inliers[back],
        noise=noise[back] * learned.extent,
        noise_level=float(np.median(learned.scale.noise)) * learned.extent,
        spacing=spacing * learned.extent,
        seconds=dict(clock.seconds),
        rules=rules.moved(learned.extent, learned.middle),
        warnings=learned.warnings,
    )
    return estimate, normals, residual


def _facing(viewpoint: Array | None, points: Array, estimate: NormalEstimate) -> NormalEstimate:
    """Turn every normal to the viewpoint, if there is one."""
    if viewpoint is None:
        return estimate
    return replace(estimate, normals=turned_to(viewpoint, points, estimate.normals))
