"""Algorithm 1 with section 3: learn oriented rules from points, and infer normals from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.geometry.checks import check_stage
from o3d_sofnn.options import Options
from o3d_sofnn.orientation.confidence import certainty
from o3d_sofnn.orientation.evidence import Evidence, found, told
from o3d_sofnn.orientation.sheets import settle
from o3d_sofnn.orientation.viewpoint import Oriented, find_sides, leaned
from o3d_sofnn.progress import Clock
from o3d_sofnn.results import NormalEstimate
from o3d_sofnn.rules.growth import grow
from o3d_sofnn.rules.inference import infer_normals
from o3d_sofnn.rules.off_surface import beside_surface
from o3d_sofnn.rules.rule_base import RuleBase, columns, fit_rules
from o3d_sofnn.rules.trust import Experience
from o3d_sofnn.sampling.local_fit import Neighborhoods
from o3d_sofnn.sampling.normalization import Cloud, unit_cube
from o3d_sofnn.sampling.outliers import MANY, Samples, part_outliers
from o3d_sofnn.sampling.quantization import Steps, spread_rounded
from o3d_sofnn.sampling.scales.choice import Limits
from o3d_sofnn.sampling.scales.refinement import refine_scale
from o3d_sofnn.sampling.scales.thinning import thinned
from o3d_sofnn.sampling.sight import between
from o3d_sofnn.sampling.suitability import unsuitable
from o3d_sofnn.sampling.typical_data import typical_data

Array = NDArray[np.float64]

ALL = 1e9
"""Radius of a neighbourhood in the unit cube that is certain to contain every point."""


class Sides(Protocol):
    """Sides of the surface that are known at any place."""

    @property
    def evidence(self) -> Evidence:
        """How they were decided."""

    def at(self, x: Array) -> Array:
        """Return unit normals, (m, 3), at points (m, 3) on the surface, in the user's unit."""


@dataclass(frozen=True)
class Learned:
    """What both operators need: oriented rules, and what they were learned from.

    Attributes
    ----------
    cloud : Cloud
        The d distinct points; everything below is in their unit.
    steps : Steps
        Step sizes to which their coordinates were rounded.
    unsure : (d,) bool
        Outliers that hang between objects, as seen from the viewpoint, and points on the sides of
        which the winding number does not agree with itself.
    samples : Samples
        The m distinct points that are not outliers.
    sides : (m, 3) float64
        Unit normals of the samples, from the winding number or from the caller.
    rules : RuleBase
        Oriented rules.
    evidence : Evidence
        How the sides were decided.
    experience : Experience or None
        Off-line rules.
    """

    cloud: Cloud
    steps: Steps
    unsure: NDArray[np.bool_]
    samples: Samples
    sides: Array
    rules: RuleBase
    evidence: Evidence
    experience: Experience | None


def learn_rules(
    points: Array,
    options: Options,
    clock: Clock,
    *,
    normals: Array | None = None,
    experience: Experience | None = None,
    enclosing: bool = False,
    decided: Sides | None = None,
) -> Learned:
    """Learn oriented rules from points.

    Parameters
    ----------
    points : (n, 3) float64
        Finite, in any unit.
    options : Options
        What the user has chosen.
    clock : Clock
        Measures and reports the stages.
    normals : (n, 3) float64, optional
        Known normals.
    experience : Experience, optional
        Off-line rules.
    enclosing : bool, default False
        Whether the surface must enclose a volume; if so, points in one plane are an error.
    decided : Sides, optional
        Sides that were decided elsewhere, among more points than these.

    Returns
    -------
    Learned

    Raises
    ------
    ValueError
        There are fewer than 4 distinct points, or they are all equal or on one line.
    """
    with clock.stage("cells"):  # Algorithm 1, steps 1 and 2
        cloud, steps = spread_rounded(unit_cube(points, enclosing))
    limits = _limits(options, cloud.extent)
    with clock.stage("scale"):  # Algorithm 1, steps 3 to 6
        samples = _inliers(cloud, options, limits)
        # Each pass divides the number of points by at least FEWEST, down to a fit at most.
        while (fewer := thinned(cloud, samples)) is not cloud:
            cloud, samples = fewer, _inliers(fewer, options, limits)
        samples = steps.floored(samples)
    with clock.stage("orientation"):
        evidence = told(normals, options.viewpoint, options.towards)
        if decided is not None:
            evidence = decided.evidence
        evidence = evidence or found(points, samples, cloud.frame)
        viewpoint = None if evidence is None else _inside(evidence.viewpoint, cloud)
        hanging = between(cloud.points, viewpoint, samples.scale)
        if hanging.any():
            samples = samples.parted(hanging[samples.kept])
        seen = None if evidence is None else evidence.directions(points)
        rows = cloud.first[samples.kept]
        known, seen = (None if x is None else x[rows] for x in (normals, seen))
        if seen is not None or hanging.any():  # the scale changes
            samples = steps.floored(samples.seen(seen, limits))
        if decided is None:
            oriented = find_sides(samples, known, seen)
        else:
            oriented = Oriented.known(decided.at(cloud.frame.outside(samples.points)))
        sides = oriented.normals
        check_stage("orientation", sides=sides)
    rules, samples = _fitted(samples, sides, limits, clock)
    disputed = np.zeros(len(cloud.points), bool)
    if evidence is None or not (evidence.sure or decided is not None):
        with clock.stage("orientation"):
            rules, sides, evidence = settle(rules, sides, samples.points, evidence, cloud.frame)
            if not evidence.decided:
                disputed[samples.kept] = oriented.disputed
                evidence = replace(evidence, warnings=evidence.warnings + oriented.warnings)
    # If there are many outliers, they have disturbed the scale and the rules: both are found again.
    many = (~samples.kept).mean() > MANY
    if many:
        with clock.stage("outliers"):  # Algorithm 1, step 5, decided by the rules
            off = beside_surface(rules, samples, sides, experience)
            samples, sides = samples.without(off, limits), sides[~off]
            samples = steps.floored(samples)
        rules, samples = _fitted(samples, sides, limits, clock)
    with clock.stage("growth"):  # section 3.2
        rules = grow(rules, samples, sides, limits, experience)
        check_stage("growth", **columns(rules))
    with clock.stage("orientation"):
        settled = decided is not None or evidence.decided
        rules = replace(rules, confidence=certainty(rules, settled))
    if many:
        with clock.stage("outliers"):
            off = beside_surface(rules, samples, sides, experience)
            samples, sides = samples.parted(off), sides[~off]
    unsure = hanging | disputed
    return Learned(cloud, steps, unsure, samples, sides, rules, evidence, experience)


def infer(learned: Learned, options: Options, clock: Clock) -> tuple[NormalEstimate, Array, Array]:
    """Infer a normal at every point, including outliers and duplicates, by eq. (7) and (9).

    Parameters
    ----------
    learned : Learned
        Oriented rules, learned from d distinct points.
    options : Options
        What the user has chosen.
    clock : Clock
        Measures and reports the stage.

    Returns
    -------
    estimate : NormalEstimate
        The result for all points.
    normals, residual : (d, 3) and (d,) float64
        Normals of the distinct points, and their distances from the surface.
    """
    with clock.stage("inference"):
        cloud, samples, rules = learned.cloud, learned.samples, learned.rules
        sides = np.zeros_like(cloud.points)
        sides[samples.kept] = learned.sides
        normals, agreement, residual = infer_normals(
            rules, cloud.points, sides=sides, experience=learned.experience
        )
        nearest = rules.foot_tree.query(cloud.points, 1, np.inf)[1][:, 0]
        confidence = np.where(learned.unsure, 0.0, agreement * rules.confidence[nearest])
        noise = rules.noise[nearest]
        spacing = float(np.median(samples.scale.spacing))
        # Where the sides of a whole sheet are arbitrary, only the rules say how it lies.
        sure = np.where(rules.confidence[nearest] > 0.0, confidence, agreement)
        doubt = (1.0 - sure) * np.minimum(1.0, 2.0 * noise / spacing)
        leaning = leaned(normals, sides, doubt)
        noise = learned.steps.given(noise, cloud.points)
        level = learned.steps.given(samples.scale.noise, samples.scale.places)
        check_stage("inference", normals=leaning, confidences=confidence, residuals=residual)
    doubts = unsuitable(samples.points, samples.tree)
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


def _fitted(
    samples: Samples, sides: Array, limits: Limits, clock: Clock
) -> tuple[RuleBase, Samples]:
    """Choose the scale again with known sides, find typical data, and fit a rule to each datum."""
    tree, points = samples.tree, samples.points
    with clock.stage("scale"):  # Algorithm 1, step 6
        scale = refine_scale(points, tree, samples.scale, sides, limits)
    with clock.stage("typical data"):  # section 3.1
        centers, facing = typical_data(points, sides, tree, scale)
        pilot = scale.at(centers)
        where = Neighborhoods(centers, facing, scale.n_neighbors[pilot], scale.noise[pilot])
    with clock.stage("rules"):  # Algorithm 1, steps 3 and 5
        rules = fit_rules(tree, points, sides, where)
    return rules, replace(samples, scale=scale)


def _inliers(cloud: Cloud, options: Options, limits: Limits) -> Samples:
    """Separate the outliers; where the scanner stood, the spacing may grow with the distance."""
    viewpoint = _inside(options.viewpoint, cloud)
    far = None if viewpoint is None else np.linalg.norm(cloud.points - viewpoint, axis=1)
    return part_outliers(cloud.points, limits, cloud.near, distance=far)


def _limits(options: Options, extent: float) -> Limits:
    """Convert the user's limits to the unit cube, where no radius needs to be larger than ALL."""
    if options.radius is None:
        return Limits(options.max_nn)
    return Limits(options.max_nn, min(options.radius / extent, ALL))


def _inside(viewpoint: Array | None, cloud: Cloud) -> Array | None:
    """Return the viewpoint of all distinct points, or of each, in the unit cube."""
    if viewpoint is None:
        return None
    x = (viewpoint - cloud.middle) / cloud.extent
    return x if x.ndim == 1 else x[cloud.first]
