"""Stages 1 to 5, from points to oriented rules: a call a stage, a file behind each."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ._kernels import KdTree
from .clock import Clock
from .experience import Experience
from .growth import adjust, combine, discard, generate, reshape
from .local_fit import Scale, choose_scale
from .octree import sort_unique
from .orientation import certainty, settle
from .outliers import MANY, distance_along_surface, off_surface, part_outliers
from .revision import read_normals, revise
from .rule_base import RuleBase
from .rules import fit_rules, infer_normals
from .scale import refine_scale
from .typical_data import sides_around, typical_data
from .validation import affine_rank
from .vectors import bounds, unit
from .winding import orient_points, seen_from

Array = NDArray[np.float64]


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
        sides = _find_sides(points, normals, viewpoint, order[inliers], clean, scale, threads)
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
            near = _part_from_surface(
                rules, clean, sides, tree, scale, inliers, threads, experience
            )
            clean, sides = clean[near], sides[near]
            tree = KdTree(clean, threads)
        with clock.stage("scale"):  # which outliers have disturbed, as the rules around them
            scale = choose_scale(clean, tree, max_nn, limit, threads)
            scale = refine_scale(clean, tree, scale, sides, max_nn, limit, threads)
        rules = _first_rules(clean, tree, scale, sides, threads, clock)
    with clock.stage("growth"):
        rules = _grow(rules, clean, tree, sides, max_nn, limit, experience, threads)
        settled = known or towards is not None
        rules = replace(rules, confidence=certainty(rules, settled, threads))
        if many:
            near = _part_from_surface(
                rules, clean, sides, tree, scale, inliers, threads, experience
            )
            sides, tree = sides[near], KdTree(clean[near], threads)
    return Learned(x, inverse, tree, scale, inliers, sides, rules, middle, extent, warnings)


def _find_sides(
    points: Array,
    normals: Array | None,
    viewpoint: Array | None,
    rows: NDArray[np.int64],
    clean: Array,
    scale: Scale,
    threads: int,
) -> Array:
    """Give the inliers, `rows` of the cloud, unit normals: the caller's or the winding number's."""
    if normals is None:
        level, spacing = float(np.median(scale.noise)), float(np.median(scale.spacing))
        sides = orient_points(clean, level, spacing, threads)
    else:
        sides = unit(normals[rows])
    if viewpoint is None:
        return sides
    places = viewpoint[rows] if viewpoint.ndim == 2 else viewpoint
    return seen_from(places, points[rows], sides)


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


def _grow(
    rules: RuleBase,
    points: Array,
    tree: KdTree,
    sides: Array,
    max_nn: int | None,
    max_radius: float | None,
    experience: Experience | None,
    threads: int,
) -> RuleBase:
    """Fit the rules anew with what they have inferred: generate, reshape, combine, adjust."""
    normals, _, residual = infer_normals(rules, points, threads, sides=sides, experience=experience)
    facing = sides_around(rules.centers, rules.normals, normals, tree, threads)
    centers, count, noise = generate(rules, points, residual, threads)
    side = infer_normals(rules, centers, threads)[0]
    size, across, stretch = reshape(rules, max_nn, max_radius)
    rules = fit_rules(
        points,
        tree,
        np.concatenate([rules.feet, centers]),
        np.concatenate([size, count]),
        np.concatenate([rules.noise, noise]),
        threads,
        normals=normals,
        sides=np.concatenate([facing, side]),
        across=np.concatenate([across, np.zeros_like(centers)]),
        stretch=np.concatenate([stretch, np.ones(len(centers))]),
    )
    rules = combine(discard(rules), threads)
    read = read_normals(rules, points, threads)
    normals[read] = infer_normals(
        rules, points[read], threads, sides=sides[read], experience=experience
    )[0]
    rules = discard(revise(rules, points, tree, normals, threads))
    return adjust(rules, points, threads)


def _part_from_surface(
    rules: RuleBase,
    points: Array,
    sides: Array,
    tree: KdTree,
    scale: Scale,
    inliers: NDArray[np.bool_],
    threads: int,
    experience: Experience | None,
) -> NDArray[np.bool_]:
    """Take points beside the surface out of the inliers, in place; True for those that stay."""
    residual = infer_normals(rules, points, threads, sides=sides, experience=experience)[2]
    along = distance_along_surface(rules, points, sides, threads)
    near = ~off_surface(residual, along, points, tree, scale, inliers, threads)
    inliers[inliers] = near
    return near
