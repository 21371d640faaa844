"""The two operators on arrays: a call a stage, a file behind each; stages 1 to 5 in `learning`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, vertex_normals
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.geometry.vectors import bounds
from o3d_sofnn.implicit.field import Field
from o3d_sofnn.implicit.units import local_surfaces
from o3d_sofnn.meshing.attributes import attribute_weights
from o3d_sofnn.meshing.mesh import mesh
from o3d_sofnn.meshing.resolution import choose_cubes
from o3d_sofnn.orientation.confidence import certainty
from o3d_sofnn.orientation.sheets import settle
from o3d_sofnn.orientation.viewpoint import find_sides, leaned, turned_to
from o3d_sofnn.progress import STAGES, Clock, ProgressCallback
from o3d_sofnn.results import NormalEstimate, SurfaceEstimate
from o3d_sofnn.rules.growth import grow
from o3d_sofnn.rules.inference import infer_normals
from o3d_sofnn.rules.off_surface import part_from_surface
from o3d_sofnn.rules.rule_base import RuleBase, fit_rules
from o3d_sofnn.rules.trust import Experience, shipped
from o3d_sofnn.sampling.cells import sort_unique
from o3d_sofnn.sampling.outliers import MANY, part_outliers
from o3d_sofnn.sampling.scale import Scale, choose_scale, refine_scale
from o3d_sofnn.sampling.typical_data import typical_data
from o3d_sofnn.validation import affine_rank, thread_count

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
    progress: ProgressCallback | None = None,
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
    progress: ProgressCallback | None = None,
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
        watertight=mesh_properties.is_closed(triangles),
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


@dataclass(frozen=True)
class Learned:
    """What both operators need: the rule base of a cloud moved and scaled into the unit cube.

    Attributes
    ----------
    points : (d, 3) float64
        Distinct points in Morton order, in the unit cube as all that follows.
    inverse : (n,) int64
        Place of each point of the cloud among them.
    tree : KdTree
        Over the m inliers.
    scale : Scale
        Of the inliers.
    inliers : (d,) bool
        False for outliers.
    sides : (m, 3) float64
        Unit normals of the inliers, as the winding number or the caller has them.
    rules : RuleBase
        Oriented rules.
    middle, extent : (3,) float64 and float
        The cloud is ``extent * x + middle``.
    warnings : tuple of str
        What a user should look at.
    """

    points: Array
    inverse: NDArray[np.int64]
    tree: KdTree
    scale: Scale
    inliers: NDArray[np.bool_]
    sides: Array
    rules: RuleBase
    middle: Array
    extent: float
    warnings: tuple[str, ...]


def learn_rules(
    points: Array,
    normals: Array | None,
    max_nn: int | None,
    radius: float | None,
    viewpoint: Array | None,
    towards: Array | None,
    threads: int,
    clock: Clock,
    experience: Experience | None,
) -> Learned:
    """Learn oriented rules from points: stages 1 to 5.

    Parameters
    ----------
    points : (n, 3) float64
        Finite, in any unit.
    normals, max_nn, radius, viewpoint, towards
        As in :func:`pipeline.reconstruct_surface` and :func:`pipeline.estimate_normals`.
    threads : int
        Threads.
    clock : Clock
        Told the stages.
    experience : Experience or None
        Off-line rules.

    Returns
    -------
    Learned

    Raises
    ------
    ValueError
        `points` has fewer than 4 rows, or they are all equal or on one line.
    """
    if len(points) < 4:
        raise ValueError(f"points: at least 4 rows expected, got {len(points)}")
    if affine_rank(points) < 2:
        raise ValueError("points are all equal or lie on one line: no surface goes through them")
    with clock.stage("cells"):
        low, high = bounds(points)
        middle, extent = 0.5 * (low + high), float((high - low).max())
        order, inverse = sort_unique(points)
        x = np.ascontiguousarray((points[order] - middle) / extent)
    with clock.stage("scale"):
        limit = None if radius is None else radius / extent
        inliers, clean, tree, scale = part_outliers(x, max_nn, limit, threads)
    with clock.stage("orientation"):
        sides = find_sides(points, normals, viewpoint, order[inliers], clean, scale, threads)
        scale = refine_scale(clean, tree, scale, sides, max_nn, limit, threads)
    rules = _first_rules(clean, tree, scale, sides, threads, clock)
    with clock.stage("rules"):
        known = normals is not None or viewpoint is not None
        warnings: tuple[str, ...] = ()
        if not known:
            rules, sides, warnings = settle(rules, sides, clean, towards, threads)
    many = (~inliers).mean() > MANY
    if many:
        with clock.stage("growth"):
            near = part_from_surface(rules, clean, sides, tree, scale, inliers, threads, experience)
            clean, sides = clean[near], sides[near]
            tree = KdTree(clean, threads)
        with clock.stage("scale"):  # which outliers have disturbed, as the rules around them
            scale = choose_scale(clean, tree, max_nn, limit, threads)
            scale = refine_scale(clean, tree, scale, sides, max_nn, limit, threads)
        rules = _first_rules(clean, tree, scale, sides, threads, clock)
    with clock.stage("growth"):
        rules = grow(rules, clean, tree, sides, max_nn, limit, experience, threads)
        settled = known or towards is not None
        rules = replace(rules, confidence=certainty(rules, settled, threads))
        if many:
            near = part_from_surface(rules, clean, sides, tree, scale, inliers, threads, experience)
            sides, tree = sides[near], KdTree(clean[near], threads)
    return Learned(x, inverse, tree, scale, inliers, sides, rules, middle, extent, warnings)


def _first_rules(
    points: Array, tree: KdTree, scale: Scale, sides: Array, threads: int, clock: Clock
) -> RuleBase:
    """Draw typical data and fit a rule to each."""
    with clock.stage("typical data"):
        centers, facing = typical_data(points, sides, tree, scale, threads)
        pilot = scale.at(centers, threads)
        size, noise = scale.n_neighbors[pilot], scale.noise[pilot]
    with clock.stage("rules"):
        return fit_rules(points, tree, centers, size, noise, threads, normals=sides, sides=facing)
