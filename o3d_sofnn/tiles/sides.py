"""Sides of the surface, decided once for all tiles: among representatives of the whole cloud.

A tile sends representatives of its points. Their winding number decides the sides of closed
surfaces; sheets and rooms are settled as in a run without tiles, with the representatives as flat
rules. A tile then takes the sides of its points from the gradient of that winding number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, WindingTree, sort_morton
from o3d_sofnn.geometry.frame import Frame
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.implicit.far_field import FarField, Level
from o3d_sofnn.meshing.borders.solids import solids
from o3d_sofnn.options import Options
from o3d_sofnn.orientation.components import turn_along
from o3d_sofnn.orientation.evidence import Evidence, found, told
from o3d_sofnn.orientation.sheets import settle
from o3d_sofnn.orientation.viewpoint import seen_sides
from o3d_sofnn.orientation.visibility import Partly
from o3d_sofnn.orientation.winding_normals import (
    BLUR,
    COARSE,
    FINE,
    OPENING,
    regional_spacing,
    representatives,
    winding_number_normals,
)
from o3d_sofnn.rules.rule_base import RuleBase
from o3d_sofnn.sampling.cells import build_octree
from o3d_sofnn.sampling.local_fit import RADIUS
from o3d_sofnn.sampling.normalization import unit_cube
from o3d_sofnn.sampling.outliers import Samples, part_outliers
from o3d_sofnn.sampling.quantization import spread_rounded
from o3d_sofnn.sampling.scales.choice import Limits
from o3d_sofnn.sampling.typical_data import RULES_PER_NEIGHBORHOOD
from o3d_sofnn.threads import thread_count

Array = NDArray[np.float64]


MOST = 40_000
"""Largest number of representatives that decide the sides of all tiles: neighbours are combined if
there are more."""


THINNED = 100_000
"""Number of points, over all tiles, that show where a scanner stood."""


@dataclass(frozen=True)
class Survey:
    """What a tile sends before the sides are known.

    Attributes
    ----------
    places : (m, 3) float64
        Representatives of its points.
    noise, count : (m,) float64
        Noise level there, and number of points that each stands for.
    thinned : (k, 3) float64
        Some of its points.
    """

    places: Array
    noise: Array
    count: Array
    thinned: Array


def survey(points: Array, own: NDArray[np.bool_], share: float, options: Options) -> Survey:
    """Represent the points of a tile.

    Parameters
    ----------
    points : (n, 3) float64
        Points of the tile and of its rim.
    own : (n,) bool
        Which of them are its own.
    share : float
        Share of the points to send as they are.
    options : Options
        What the user has chosen.
    """
    rows = np.flatnonzero(own)
    few = np.linspace(0, len(rows) - 1, int(np.ceil(share * len(rows)))).astype(np.int64)
    samples, frame, row = samples_of(points, options)
    scale = samples.scale
    noise, spacing = float(np.median(scale.noise)), float(np.median(scale.spacing))
    places, stands = representatives(samples.points, noise / spacing)
    mine = np.bincount(stands, own[row], len(places))
    kept = mine >= 0.5 * np.bincount(stands, minlength=len(places))
    at = scale.noise[scale.at(np.ascontiguousarray(places[kept]))] if kept.any() else np.zeros(0)
    return Survey(
        frame.outside(places[kept]),
        at * frame.extent,
        mine[kept].astype(np.float64),
        points[rows[few]].copy(),
    )


def samples_of(points: Array, options: Options) -> tuple[Samples, Frame, NDArray[np.int64]]:
    """Return the points on the surface in a unit of their own, and the rows of the originals."""
    cloud, steps = spread_rounded(unit_cube(points))
    radius = None if options.radius is None else options.radius / cloud.extent
    samples = part_outliers(cloud.points, Limits(options.max_nn, radius), cloud.near)
    return steps.floored(samples), cloud.frame, cloud.first[samples.kept]


@dataclass(frozen=True)
class Representatives:
    """Representatives of the whole cloud, with their sides: what every tile gets.

    Attributes
    ----------
    places : (m, 3) float64
        Their positions.
    moments : (m, 3) float64
        Area-weighted normals by the winding number alone.
    noise, spacing : (m,) float64
        Noise level and distance between representatives.
    turned : (m, 3) float64
        Unit normals after sheets and rooms have been settled.
    replaced : (m,) bool
        Representatives on sheets whose side does not come from the winding number.
    solid : (m,) bool
        Representatives on solids.
    evidence : Evidence
        How the sides were decided.
    """

    places: Array
    moments: Array
    noise: Array
    spacing: Array
    turned: Array
    replaced: NDArray[np.bool_]
    solid: NDArray[np.bool_]
    evidence: Evidence

    def at(self, x: Array) -> Array:
        """Return unit normals, (n, 3), at points (n, 3) on the surface."""
        x = np.ascontiguousarray(x)
        sources = WindingTree(self.places, np.linalg.norm(self.moments, axis=1), thread_count())
        width = np.maximum(self._fine, BLUR * self.noise)[self.nearest(x)]
        gradient = sources.gradient(self.moments, x, width, OPENING)[1]
        sides = unit(np.asarray(gradient))
        directions = self.evidence.directions(x)
        if directions is not None:
            return unit(seen_sides(directions, sides, x) + unit(directions))
        before = flat_rules(self.places, unit(self.moments), self.spacing, self.noise)
        sides = turn_along(sides, x, before, before.facing(self.turned), self.replaced)
        if isinstance(self.evidence.sight, Partly):
            sides = seen_sides(self.evidence.sight.directions(x), sides, x)
        return sides

    def nearest(self, x: Array) -> NDArray[np.int64]:
        """Return the index of the representative nearest to each of some points."""
        tree = KdTree(self.places, thread_count())
        return np.asarray(tree.query(np.ascontiguousarray(x), 1, np.inf)[1][:, 0])

    def level(self) -> Level:
        """Return the winding number on the surface."""
        return FarField.of(self.places, self.turned, self.spacing, self.solid).level

    @property
    def _fine(self) -> Array:
        return np.hypot(FINE[0] * self.spacing, FINE[1] * self.noise)


def orient(surveys: Sequence[Survey], options: Options, most: int = MOST) -> Representatives:
    """Decide the sides of the whole surface.

    Parameters
    ----------
    surveys : sequence of Survey
        What the tiles have sent, in their order.
    options : Options
        What the user has chosen.
    most : int
        Largest number of representatives.
    """
    x, noise = gathered(surveys, most)
    low, high = x.min(axis=0), x.max(axis=0)
    frame = Frame(0.5 * (low + high), float((high - low).max()) or 1.0)
    x, noise = np.ascontiguousarray(frame.inside(x)), noise / frame.extent
    spacing = regional_spacing(x, KdTree(x, thread_count()))
    coarse, fine = (np.hypot(a * spacing, b * noise) for a, b in (COARSE, FINE))
    moments = winding_number_normals(x, spacing**2, coarse, fine)
    evidence = told(None, options.viewpoint, options.towards)
    evidence = evidence or _stations(surveys, options)
    rules = flat_rules(x, unit(moments), spacing, noise)
    normals, replaced = rules.normals, np.zeros(len(x), bool)
    if evidence is None or not evidence.sure:
        before = rules
        rules, normals, evidence = settle(rules, normals, x, evidence, frame)
        replaced = np.einsum("md,md->m", before.normals, rules.normals) < 0.0
    else:
        directions = evidence.directions(frame.outside(x))
        assert directions is not None
        directions = unit(directions)
        normals = unit(seen_sides(directions, normals, x) + directions)
        rules = rules.facing(normals)
    return Representatives(
        frame.outside(x),
        moments * frame.extent**2,
        noise * frame.extent,
        spacing * frame.extent,
        normals,
        replaced,
        solids(rules, x)[1],
        evidence,
    )


def gathered(surveys: Sequence[Survey], most: int) -> tuple[Array, Array]:
    """Return places and noise, (m, 3) and (m,), of at most so many representatives of all tiles."""
    x, noise, count = (
        np.concatenate([getattr(each, name) for each in surveys])
        for name in ("places", "noise", "count")
    )
    order = np.asarray(sort_morton(np.ascontiguousarray(x), thread_count())[1])
    x, noise, count = np.ascontiguousarray(x[order]), noise[order], count[order]
    capacity = 1
    while len(x) > most:
        capacity += 1
        cells = build_octree(x, capacity)
        if len(cells.size) <= most:
            x, noise, count = (
                np.add.reduceat(_by(count, each)[cells.order], cells.offsets[:-1])
                for each in (x, noise, np.ones(len(x)))
            )
            return x / count[:, None], noise / count
    return x, noise


def _by(count: Array, values: Array) -> Array:
    return values * (count[:, None] if values.ndim > 1 else count)


def _stations(surveys: Sequence[Survey], options: Options) -> Evidence | None:
    """Find out from some of the points where a scanner stood."""
    points = np.concatenate([each.thinned for each in surveys])
    samples, frame, _ = samples_of(points, options)
    return found(points, samples, frame)


def flat_rules(places: Array, normals: Array, spacing: Array, noise: Array) -> RuleBase:
    """Return a flat rule for each representative, with the area of its spacing squared."""
    n = len(places)
    least = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = unit(np.cross(normals, least))
    frames = np.stack([first, np.cross(normals, first), normals], axis=1)
    return RuleBase(
        centers=np.ascontiguousarray(places),
        frames=np.ascontiguousarray(frames),
        coefficients=np.zeros((n, 6)),
        radius=RADIUS * np.sqrt(RULES_PER_NEIGHBORHOOD / np.pi) * spacing,
        stretch=np.ones(n),
        residual=noise,
        support=np.ones(n),
        n_neighbors=np.full(n, int(RULES_PER_NEIGHBORHOOD), np.int64),
        noise=noise,
        confidence=np.ones(n),
    )
