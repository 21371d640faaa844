"""The first half of the work on a tile: from points to a part of the surface."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.algorithm1 import infer, learn_rules
from o3d_sofnn.algorithm2 import local_parts
from o3d_sofnn.implicit.far_field import dipole_areas
from o3d_sofnn.implicit.units import LocalSurfaces
from o3d_sofnn.meshing.isosurface.grid import BEYOND, LEAST, MARGIN
from o3d_sofnn.meshing.isosurface.resolution import (
    FEWEST,
    FINER,
    SHEET,
    SIDE,
    Fits,
    flat_edges,
    typical_edges,
)
from o3d_sofnn.options import Options
from o3d_sofnn.progress import Clock
from o3d_sofnn.rules.rule_base import RuleBase
from o3d_sofnn.rules.trust import shipped
from o3d_sofnn.threads import thread_count
from o3d_sofnn.tiles.blocks import Run
from o3d_sofnn.tiles.lattice import Lattice
from o3d_sofnn.tiles.patch import Patch, Samples, rows_of
from o3d_sofnn.tiles.plan import Tile

if TYPE_CHECKING:
    from o3d_sofnn.tiles.sides import Representatives

Array = NDArray[np.float64]


ASKED = 500
"""Number of rules of a tile that have a say in the figures of the run."""


def make_patch(
    parts: tuple[RuleBase, LocalSurfaces],
    samples: tuple[Array, Array],
    spacing: Array,
    solid: NDArray[np.bool_],
) -> Patch:
    """Make a patch of the surface.

    Parameters
    ----------
    parts : RuleBase and LocalSurfaces
        Rules and their local surfaces.
    samples : (n, 3) and (n, 3) float64
        Points on the surface in Morton order, and their unit normals.
    spacing : (n,) float64
        Distance between neighbouring samples.
    solid : (n,) bool
        Samples on solids.
    """
    rules, (places, normals) = parts[0], samples
    nearest = rules.center_tree.query(places, 1, np.inf)
    fits = Fits.at(rules, flat_edges(rules), nearest[1][:, 0])
    areas = dipole_areas(places, spacing)
    confidence = np.where(solid, fits.confidence, 1.0)
    return Patch(
        *parts,
        Samples(places, normals, spacing, areas, solid, fits.flat, fits.radius, confidence),
    )


@dataclass(frozen=True)
class Figures:
    """What a tile says about the figures of the run: some of its rules.

    Attributes
    ----------
    flat, radius, spacing, noisiness : (k,) float64
        Of each: edge of a cube in which it is flat, radius, spacing of the points around it with
        the factor of sheets, and how far its noise level is noise.
    weight : float
        Number of points that each stands for.
    points : int
        Number of points on the surface.
    low, high : (3,) float64
        Box of these points.
    """

    flat: Array
    radius: Array
    spacing: Array
    noisiness: Array
    weight: float
    points: int
    low: Array
    high: Array


@dataclass(frozen=True)
class Taught:
    """What a tile has learned.

    Attributes
    ----------
    patch : Patch
        Its own rules and samples.
    figures : Figures or None
        None if none of its points is on a surface.
    normals : (n, 3) float64
        Unit normals of its own points.
    confidence, noise : (n,) float64
    outliers : (n,) bool
    warnings : tuple of str
    """

    patch: Patch
    figures: Figures | None
    normals: Array
    confidence: Array
    noise: Array
    outliers: NDArray[np.bool_]
    warnings: tuple[str, ...]


def learn_tile(points: Array, tile: Tile, sides: Representatives, options: Options) -> Taught:
    """Learn the rules of a tile (Algorithms 1 and 2).

    Parameters
    ----------
    points : (n, 3) float64
        Points of the tile and of its rim, in the coordinates of the run.
    tile : Tile
        The tile.
    sides : Representatives
        The sides of the surface.
    options : Options
        What the user has chosen.

    Raises
    ------
    ValueError
        The points are fewer than four, or on one line.
    """
    clock = Clock(None)
    learned = learn_rules(points, options, clock, experience=shipped(), decided=sides)
    estimate, facing, residual = infer(learned, options, clock)
    cloud, samples = learned.cloud, learned.samples
    local = local_parts(learned, facing, residual, options, clock)
    places = cloud.frame.outside(local.on_surface)
    solid = sides.solid[sides.nearest(places)]
    spacing = local.spacing(samples, solid) * cloud.extent
    rules = local.rules.moved(cloud.extent, cloud.middle)
    surfaces = replace(
        local.surfaces,
        error=local.surfaces.error * cloud.extent,
        worst=cloud.frame.outside(local.surfaces.worst),
        precision=local.surfaces.precision * cloud.extent,
    )
    whole = make_patch((rules, surfaces), (places, local.facing), spacing, solid)
    own = tile.holds(points)
    first = cloud.first[samples.kept]
    patch = whole.taken(tile.holds(rules.centers), own[first])
    return Taught(
        patch,
        _figures(patch, solid[own[first]]),
        sides.evidence.turned(points[own], estimate.normals[own]),
        estimate.confidence[own],
        estimate.noise[own],
        estimate.outliers[own],
        estimate.warnings,
    )


def _figures(patch: Patch, solid: NDArray[np.bool_]) -> Figures | None:
    """Return the figures of some rules, evenly chosen."""
    rules, samples = patch.rules, patch.samples
    if not (len(rules) and len(samples.places)):
        return None
    rows = np.linspace(0, len(rules) - 1, min(ASKED, len(rules))).astype(np.int64)
    some = rows_of(rules, rows)
    nearest = KdTree(samples.places, thread_count()).query(some.feet, 1, np.inf)[1][:, 0]
    spacing = samples.spacing[nearest] * np.where(solid[nearest], 1.0, SHEET)
    return Figures(
        flat_edges(rules)[rows],
        some.radius,
        spacing,
        some.noisiness,
        len(samples.places) / len(rows),
        len(samples.places),
        samples.places.min(axis=0),
        samples.places.max(axis=0),
    )


def run_of(figures: Sequence[Figures], sides: Representatives, options: Options) -> Run:
    """Choose the figures of the run: the edge of its cells, noisiness, walls and level.

    Parameters
    ----------
    figures : sequence of Figures
        What the tiles say, in their order.
    sides : Representatives
        The sides of the surface.
    options : Options
        What the user has chosen, in the coordinates of the run.
    """
    low = np.min([each.low for each in figures], axis=0)
    high = np.max([each.high for each in figures], axis=0)
    side, n = float((high - low).max()), sum(each.points for each in figures)
    flat, radius, spacing, noisiness = (
        np.concatenate([getattr(each, name) for each in figures])
        for name in ("flat", "radius", "spacing", "noisiness")
    )
    weight = np.concatenate([np.full(len(each.flat), each.weight) for each in figures])
    noise = weighted_median(noisiness, weight)
    voxel = side / 2**options.depth if options.depth is not None else options.voxel_size
    if voxel is None:
        usual = weighted_median(spacing, weight)
        wanted = weighted_median(typical_edges(usual, radius, flat), weight)
        finest = side / max(SIDE, 1.25 * float(np.sqrt(n)))
        size, finer = min(max(wanted, finest), side / FEWEST), FINER
    else:
        size, finer = voxel, 0
    # Most cubes are larger than finest cells: the wall must be beyond the usual ones.
    wall = min(MARGIN * size, max(BEYOND * side, LEAST * size))
    lattice = Lattice(size / 2**finer, finer)
    return Run(lattice, sides.level, noise, low - wall, high + wall)


def weighted_median(values: Array, weight: Array) -> float:
    """Return the value up to which half of the weight is."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weight[order])
    return float(values[order[np.searchsorted(total, 0.5 * total[-1])]])
