"""Sides of the surface, decided once for all tiles: by Algorithm 1 on points of the whole cloud.

Every tile sends some of its points. A run without tiles on these settles the sides of solids,
sheets and rooms, and where a scanner stood. A tile takes the sides of its points from the gradient
of the winding number of those: near ones one by one, far ones by the moments of a tree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, WindingTree, sort_morton
from o3d_sofnn.algorithm1 import infer, learn_rules
from o3d_sofnn.algorithm2 import local_parts
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.implicit.far_field import FarField, Level, dipole_areas
from o3d_sofnn.meshing.borders.solids import solids
from o3d_sofnn.options import Options
from o3d_sofnn.orientation.evidence import Evidence
from o3d_sofnn.orientation.viewpoint import BLUR, FINE
from o3d_sofnn.orientation.winding_normals import OPENING
from o3d_sofnn.progress import Clock
from o3d_sofnn.rules.trust import shipped
from o3d_sofnn.threads import thread_count

Array = NDArray[np.float64]


MOST = 150_000
"""Number of points, over all tiles, that decide the sides: all of a smaller cloud."""


def evenly(points: Array, share: float) -> Array:
    """Return so large a share of some points, (n, 3), spread evenly along the Morton curve."""
    count = int(np.ceil(share * len(points)))
    if not len(points) or count >= len(points):
        return points
    order = np.asarray(sort_morton(np.ascontiguousarray(points), thread_count())[1])
    rows = np.linspace(0, len(points) - 1, count).astype(np.int64)
    return np.ascontiguousarray(points[order[rows]])


@dataclass(frozen=True)
class Representatives:
    """Points of the whole cloud with their sides: what every tile gets.

    Attributes
    ----------
    places, normals : (m, 3) float64
        Points on the surface in Morton order, and unit normals on the outer side.
    areas, width : (m,) float64
        Area that each represents, and smoothing width of the winding number there.
    solid : (m,) bool
        Points on solids.
    level : Level
        Winding number on the surface.
    evidence : Evidence
        How the sides were decided.
    """

    places: Array
    normals: Array
    areas: Array
    width: Array
    solid: NDArray[np.bool_]
    level: Level
    evidence: Evidence

    def at(self, x: Array) -> Array:
        """Return unit normals, (n, 3), at points (n, 3) on the surface."""
        x = np.ascontiguousarray(x)
        tree = WindingTree(self.places, self.areas, thread_count())
        moments = self.areas[:, None] * self.normals
        gradient = tree.gradient(moments, x, self.width[self.nearest(x)], OPENING)[1]
        return unit(np.asarray(gradient))

    def nearest(self, x: Array) -> NDArray[np.int64]:
        """Return the index of the representative nearest to each of some points."""
        tree = KdTree(self.places, thread_count())
        return np.asarray(tree.query(np.ascontiguousarray(x), 1, np.inf)[1][:, 0])


def orient(parts: Sequence[Array], options: Options) -> Representatives:
    """Decide the sides of the whole surface.

    Parameters
    ----------
    parts : sequence of (k, 3) float64
        Points that the tiles have sent, in the order of the tiles.
    options : Options
        What the user has chosen.

    Raises
    ------
    ValueError
        The points are fewer than four, or all on one line.
    """
    points, clock = np.concatenate(parts), Clock(None)
    learned = learn_rules(points, options, clock, experience=shipped())
    _, facing, residual = infer(learned, options, clock)
    local = local_parts(learned, facing, residual, options, clock)
    solid = solids(local.rules, local.on_surface)[1]
    spacing = local.spacing(learned.samples, solid)
    areas = dipole_areas(local.on_surface, spacing)
    scale, frame = learned.samples.scale, learned.cloud.frame
    noise = scale.noise[scale.at(local.inliers)]
    width = np.maximum(np.hypot(FINE[0] * spacing, FINE[1] * noise), BLUR * noise)
    places = np.ascontiguousarray(frame.outside(local.on_surface))
    level = FarField.of(places, local.facing, spacing * frame.extent, solid).level
    return Representatives(
        places,
        local.facing,
        areas * frame.extent**2,
        width * frame.extent,
        solid,
        level,
        learned.evidence,
    )
