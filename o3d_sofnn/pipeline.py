"""The method, top to bottom: two operators on arrays, a call a stage, a file behind each call."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, vertex_normals
from o3d_sofnn.geometry.checks import check_mesh, check_stage
from o3d_sofnn.geometry.quality import Inliers, assess
from o3d_sofnn.geometry.vectors import longest_side
from o3d_sofnn.implicit.field import Field
from o3d_sofnn.implicit.units import local_surfaces
from o3d_sofnn.meshing.attributes import attribute_weights
from o3d_sofnn.meshing.closing import VOUCHED, Judge, solids
from o3d_sofnn.meshing.decimation import unmet
from o3d_sofnn.meshing.mesh import mesh
from o3d_sofnn.meshing.resolution import RESOLVES, SHEET, choose_cubes, local_spacing
from o3d_sofnn.options import Options
from o3d_sofnn.orientation.confidence import certainty
from o3d_sofnn.orientation.evidence import Evidence, found, told
from o3d_sofnn.orientation.sheets import settle
from o3d_sofnn.orientation.viewpoint import find_sides, leaned
from o3d_sofnn.progress import STAGES, Clock, ProgressCallback
from o3d_sofnn.results import NormalEstimate, SurfaceEstimate
from o3d_sofnn.rules.growth import grow
from o3d_sofnn.rules.inference import infer_normals
from o3d_sofnn.rules.off_surface import beside_surface
from o3d_sofnn.rules.rule_base import RuleBase, fit_rules
from o3d_sofnn.rules.trust import Experience, shipped
from o3d_sofnn.sampling.local_fit import Neighborhoods
from o3d_sofnn.sampling.normalization import Cloud, unit_cube
from o3d_sofnn.sampling.outliers import MANY, Samples, part_outliers
from o3d_sofnn.sampling.quantization import Steps, spread_rounded
from o3d_sofnn.sampling.scales.choice import Limits
from o3d_sofnn.sampling.scales.refinement import refine_scale
from o3d_sofnn.sampling.sight import between
from o3d_sofnn.sampling.suitability import unsuitable
from o3d_sofnn.sampling.typical_data import typical_data
from o3d_sofnn.validation import thread_count

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
        Attributes of :class:`Options` by name, over those of `options`.

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
        Known sides: the surface faces them. None finds the sides from the points. Not together with
        a viewpoint or a direction in `options`.
    progress : callable, optional
        Called with the fraction done and the name of the stage that begins.
    **fields
        Attributes of :class:`Options` by name, over those of `options`.

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
    learned = learn_rules(
        points,
        options,
        clock,
        normals=normals,
        experience=shipped(),
        enclosing=options.closes is True,
    )
    estimate, facing, residual = infer(learned, options, clock)
    threads, cloud, samples = thread_count(options.n_threads), learned.cloud, learned.samples
    facing, residual = facing[samples.kept], residual[samples.kept]
    with clock.stage("local surfaces"):  # Algorithm 2
        precision = None if options.precision is None else options.precision / cloud.extent
        inliers = cloud.points if samples.kept.all() else cloud.points[samples.kept]
        rules, surfaces = local_surfaces(
            learned.rules, inliers, facing, samples.tree, threads, precision
        )
    with clock.stage("field"):  # section 4
        on_surface = inliers - residual[:, None] * facing
        scale = samples.scale
        solid, on_solid = solids(rules, on_surface, threads)
        spacing = scale.spacing[scale.at(inliers, threads)]
        spacing = local_spacing(spacing, on_solid, inliers, samples.tree, threads)
        # On a sheet cubes may be larger: the winding number says nothing of how thin it is.
        thick = replace(rules, confidence=np.where(solid, rules.confidence, 1.0))
        wider = np.where(on_solid, 1.0, SHEET)
        size, finest, levels = choose_cubes(
            inliers,
            on_surface,
            wider * spacing,
            float(np.median(scale.spacing) * np.median(wider)),
            thick,
            _voxel_size(options, inliers, cloud.extent),
            threads,
        )
        edges = finest * np.exp2(levels)
        implicit = Field(rules, surfaces, on_surface, facing, np.maximum(spacing, edges), threads)
        spacing = np.maximum(spacing, RESOLVES * edges)
        asked = _asked(points, estimate, learned, spacing)
    del learned, samples, inliers, facing, residual, wider, edges  # a third of what is held
    with clock.stage("surface"):
        vertices, triangles, confidence, closing = mesh(
            implicit,
            on_surface,
            finest,
            levels,
            _border(options, implicit, on_solid, spacing),
            options.target_triangles,
            threads,
        )
        as_closed = options.closes is True or (closing is not None and closing.closed)
        watertight = check_mesh(vertices, triangles, closed=as_closed)
    far = np.flatnonzero(confidence == 0.0)
    distance, sample = implicit.nearest(vertices[far], 1)
    beyond = np.zeros(len(vertices))
    beyond[far] = (distance / (VOUCHED * spacing[sample]))[:, 0]
    del implicit, on_surface
    with clock.stage("attributes"):
        facing = np.asarray(vertex_normals(vertices, triangles))
        near = np.flatnonzero(confidence > 0.0)
        facing[near] = infer_normals(rules, vertices[near], threads)[0]
        check_stage("attributes", normals=facing, confidences=confidence)
        quality = assess(vertices, triangles, beyond, asked, threads)
    clock.finish()
    warnings = estimate.warnings + unmet(options.target_triangles, len(triangles))
    return SurfaceEstimate(
        vertices=vertices * cloud.extent + cloud.middle,
        triangles=triangles,
        vertex_normals=facing,
        confidence=confidence,
        weigh=partial(attribute_weights, vertices, cloud.points, cloud.inverse, size, threads),
        normals=_facing(points, replace(estimate, warnings=warnings)),
        offset_points=surfaces.offset_points,
        voxel_size=options.voxel_size or size * cloud.extent,
        seconds=clock.seconds,
        watertight=watertight,
        closing=closing,
        quality=replace(quality, border_length=quality.border_length * cloud.extent),
    )


@dataclass(frozen=True)
class Learned:
    """What both operators need: oriented rules, and what they were learned from.

    Attributes
    ----------
    cloud : Cloud
        Distinct points; all that follows is in their unit.
    steps : Steps
        To which their coordinates were rounded.
    hanging : (d,) bool
        Outliers between things, as seen from the viewpoint.
    samples : Samples
        The m of them that are no outliers.
    sides : (m, 3) float64
        Unit normals of the samples, as the winding number or the caller has them.
    rules : RuleBase
        Oriented rules.
    evidence : Evidence
        What the sides were decided by.
    """

    cloud: Cloud
    steps: Steps
    hanging: NDArray[np.bool_]
    samples: Samples
    sides: Array
    rules: RuleBase
    evidence: Evidence


def learn_rules(
    points: Array,
    options: Options,
    clock: Clock,
    *,
    normals: Array | None = None,
    experience: Experience | None = None,
    enclosing: bool = False,
) -> Learned:
    """Learn oriented rules from points.

    Parameters
    ----------
    points : (n, 3) float64
        Finite, in any unit.
    options : Options
        What the user has chosen.
    clock : Clock
        Told the stages.
    normals : (n, 3) float64, optional
        Known normals.
    experience : Experience, optional
        Off-line rules.
    enclosing : bool, default False
        Whether the surface shall enclose something: points in one plane are an error.

    Returns
    -------
    Learned

    Raises
    ------
    ValueError
        Fewer than 4 distinct points, or they are all equal or on one line.
    """
    threads = thread_count(options.n_threads)
    with clock.stage("cells"):  # Algorithm 1, steps 1 and 2
        cloud, steps = spread_rounded(unit_cube(points, enclosing), threads)
    limits = _limits(options, cloud.extent)
    with clock.stage("scale"):  # Algorithm 1, steps 3 to 6
        viewpoint = _inside(options.viewpoint, cloud)
        far = None if viewpoint is None else np.linalg.norm(cloud.points - viewpoint, axis=1)
        samples = part_outliers(cloud.points, limits, threads, cloud.near, distance=far)
        samples = steps.floored(samples, threads)
    with clock.stage("orientation"):
        evidence = told(normals, options.viewpoint, options.towards)
        evidence = evidence or found(points, samples, cloud.frame, threads)
        viewpoint = None if evidence is None else _inside(evidence.viewpoint, cloud)
        hanging = between(cloud.points, viewpoint, samples.scale, threads)
        if hanging.any():
            samples = samples.without(hanging[samples.kept], limits, threads)
            samples = steps.floored(samples, threads)
        seen = None if evidence is None else evidence.directions(points)
        rows = cloud.first[samples.kept]
        known, seen = (None if x is None else x[rows] for x in (normals, seen))
        if seen is not None:
            samples = steps.floored(samples.seen(seen, limits, threads), threads)
        sides = find_sides(samples, known, seen, threads)
        check_stage("orientation", sides=sides)
    rules, samples = _first_rules(samples, sides, limits, clock, threads)
    if evidence is None or not evidence.sure:
        with clock.stage("orientation"):
            rules, sides, evidence = settle(
                rules, sides, samples.points, evidence, cloud.frame, threads
            )
    # Many outliers have disturbed the scale and the rules around them: both are found once more.
    many = (~samples.kept).mean() > MANY
    if many:
        with clock.stage("outliers"):  # Algorithm 1, step 5, asked of the rules
            off = beside_surface(rules, samples, sides, experience, threads)
            samples, sides = samples.without(off, limits, threads), sides[~off]
            samples = steps.floored(samples, threads)
        rules, samples = _first_rules(samples, sides, limits, clock, threads)
    with clock.stage("growth"):  # section 3.2
        rules = grow(rules, samples, sides, limits, experience, threads)
        check_stage("growth", **vars(rules))
    with clock.stage("orientation"):
        rules = replace(rules, confidence=certainty(rules, evidence.decided, threads))
    if many:
        with clock.stage("outliers"):
            off = beside_surface(rules, samples, sides, experience, threads)
            samples, sides = samples.parted(off, threads), sides[~off]
    return Learned(cloud, steps, hanging, samples, sides, rules, evidence)


def infer(learned: Learned, options: Options, clock: Clock) -> tuple[NormalEstimate, Array, Array]:
    """Infer a normal at every point, outliers and duplicates included, eq. (7) and (9).

    Parameters
    ----------
    learned : Learned
        Oriented rules of d distinct points.
    options : Options
        What the user has chosen.
    clock : Clock
        Told the stage.

    Returns
    -------
    estimate : NormalEstimate
        Of all points.
    normals, residual : (d, 3) and (d,) float64
        Of the distinct points.
    """
    with clock.stage("inference"):
        cloud, samples, rules = learned.cloud, learned.samples, learned.rules
        threads = thread_count(options.n_threads)
        sides = np.zeros_like(cloud.points)
        sides[samples.kept] = learned.sides
        normals, agreement, residual = infer_normals(
            rules, cloud.points, threads, sides=sides, experience=shipped()
        )
        nearest = KdTree(rules.feet, threads).query(cloud.points, 1, np.inf, threads)[1][:, 0]
        confidence = np.where(learned.hanging, 0.0, agreement * rules.confidence[nearest])
        noise = rules.noise[nearest]
        spacing = float(np.median(samples.scale.spacing))
        doubt = (1.0 - confidence) * np.minimum(1.0, 2.0 * noise / spacing)
        leaning = leaned(normals, sides, doubt)
        noise = learned.steps.given(noise, cloud.points, threads)
        level = learned.steps.given(samples.scale.noise, samples.scale.places, threads)
        check_stage("inference", normals=leaning, confidences=confidence, residuals=residual)
    doubts = unsuitable(samples.points, samples.tree, threads)
    back = cloud.inverse
    estimate = NormalEstimate(
        normals=leaning[back],
        confidence=confidence[back],
        outliers=~samples.kept[back],
        noise=noise[back] * cloud.extent,
        noise_level=float(np.median(level)) * cloud.extent,
        spacing=spacing * cloud.extent,
        seconds=dict(clock.seconds),
        rules=rules.moved(cloud.extent, cloud.middle),
        evidence=learned.evidence,
        warnings=cloud.warnings + doubts + learned.evidence.warnings,
    )
    return estimate, normals, residual


def _inside(viewpoint: Array | None, cloud: Cloud) -> Array | None:
    """Where all distinct points were seen from, or each, in the unit cube."""
    if viewpoint is None:
        return None
    x = (viewpoint - cloud.middle) / cloud.extent
    return x if x.ndim == 1 else x[cloud.first]


def _limits(options: Options, extent: float) -> Limits:
    return Limits(options.max_nn, None if options.radius is None else options.radius / extent)


def _voxel_size(options: Options, inliers: Array, extent: float) -> float | None:
    if options.depth is not None:
        return float(longest_side(inliers) / 2**options.depth)
    return None if options.voxel_size is None else options.voxel_size / extent


def _border(
    options: Options, implicit: Field, on_solid: NDArray[np.bool_], spacing: Array
) -> Judge | float | None:
    """Say where the surface ends: where a judge says, at the user's level, or nowhere."""
    if options.closes is True:
        return None
    if options.trim is None or options.trim == "auto":
        return Judge(implicit, on_solid, spacing, options.closes == "auto")
    return options.trim


def _asked(points: Array, estimate: NormalEstimate, learned: Learned, spacing: Array) -> Inliers:
    """Return what the mesh is checked against: a part of the inliers."""
    cloud, kept = learned.cloud, learned.samples.kept
    rows = cloud.first[kept]
    directions = learned.evidence.directions(points)
    return Inliers.some(
        cloud.points[kept],
        np.maximum(spacing, 2.0 * estimate.noise[rows] / cloud.extent),
        None if directions is None else directions[rows],
    )


def _first_rules(
    samples: Samples, sides: Array, limits: Limits, clock: Clock, threads: int
) -> tuple[RuleBase, Samples]:
    """Choose the scale anew with sides, draw typical data, and fit a rule to each."""
    tree, points = samples.tree, samples.points
    with clock.stage("scale"):  # Algorithm 1, step 6
        scale = refine_scale(points, tree, samples.scale, sides, limits, threads)
    with clock.stage("typical data"):  # section 3.1
        centers, facing = typical_data(points, sides, tree, scale, threads)
        pilot = scale.at(centers, threads)
        where = Neighborhoods(centers, facing, scale.n_neighbors[pilot], scale.noise[pilot])
    with clock.stage("rules"):  # Algorithm 1, steps 3 and 5
        rules = fit_rules(tree, points, sides, where, threads)
    return rules, replace(samples, scale=scale)


def _facing(points: Array, estimate: NormalEstimate) -> NormalEstimate:
    """Turn every normal to where its point was seen from, if that is known."""
    return replace(estimate, normals=estimate.evidence.turned(points, estimate.normals))
