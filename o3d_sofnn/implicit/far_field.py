"""Winding number of the samples far from them, and the level that parts inside and outside."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, WindingTree
from o3d_sofnn.geometry.neighbors import neighborhood_areas
from o3d_sofnn.orientation.winding_normals import OPENING
from o3d_sofnn.threads import thread_count

WIDTH = 0.75
"""Smoothing width of the winding number, divided by the spacing."""


PLACES = 50_000
"""Number of samples that suffice to estimate the mean winding number of all."""


LONE = 8.0
"""Largest edge of the square that a sample covers, divided by the spacing. Without this limit, an
isolated clump of fewer points than the neighbours searched for would weigh as much as a room."""


ALIKE = 8
"""Largest number of consecutive samples that share one area."""


LEVELS, AVERAGED, NEAR_LEVELS = 2000, 64, 4
"""Places at which the level of the winding number is known, samples in the mean at each, and those
that are blended. In a room or beside a sheet the winding number on the surface depends on how much
of the rest is seen from there: one level for all lost 38 % of the points of a street."""


SAME = 0.1
"""Difference from the level of all that is no difference."""


Array = NDArray[np.float64]


@dataclass(frozen=True)
class Level:
    """Winding number on the surface: one level, and its differences at some places.

    Attributes
    ----------
    typical : float
        Mean level of all samples.
    places : (p, 3) float64
        Places at which the level differs; none where it is the same everywhere.
    off : (p,) float64
        Differences at these places.
    """

    typical: float
    places: Array
    off: Array

    @cached_property
    def tree(self) -> KdTree:
        """Tree of the places."""
        return KdTree(np.ascontiguousarray(self.places), thread_count())

    def __reduce__(self) -> tuple[type[Level], tuple[float, Array, Array]]:
        """Leave out the tree, which is made anew."""
        return Level, (self.typical, self.places, self.off)

    def at(self, x: Array) -> Array | float:
        """Return the winding number that parts inside and outside around places, (m, 3)."""
        if not len(self.off):
            return self.typical
        distance, near = self.tree.query(x, min(NEAR_LEVELS, len(self.off)), np.inf)
        weight = 1.0 / np.maximum(distance, 1e-9) ** 2
        return np.asarray(self.typical + (weight * self.off[near]).sum(axis=1) / weight.sum(axis=1))


class FarField:
    """Winding number of dipoles, and its level.

    Parameters
    ----------
    places : (n, 3) float64
        Positions of the dipoles.
    areas : (n,) float64
        Area that each represents.
    dipoles : (n, 3) float64
        Normals of these areas, as long as the area.
    level : Level
        The level on the surface.
    """

    def __init__(self, places: Array, areas: Array, dipoles: Array, level: Level) -> None:
        self._tree = WindingTree(np.ascontiguousarray(places), areas, thread_count())
        self._dipoles, self.level = np.ascontiguousarray(dipoles), level

    @classmethod
    def of(
        cls, samples: Array, normals: Array, spacing: Array, solid: NDArray[np.bool_]
    ) -> FarField:
        """Return the far field of samples.

        Parameters
        ----------
        samples, normals : (n, 3) float64
            Points on the surface in Morton order, and their unit normals.
        spacing : (n,) float64
            Local distance between neighbouring samples.
        solid : (n,) bool
            True for samples on a solid, False for those on a sheet or in a room.
        """
        weight = dipole_areas(samples, spacing)
        far = cls(samples, weight, weight[:, None] * normals, Level(0.0, samples[:0], spacing[:0]))
        # As in Poisson reconstruction, the level is the mean at the samples: 1/2 on closed data.
        some = slice(None, None, 1 + len(samples) // PLACES)
        places = np.ascontiguousarray(samples[some])
        winding = far.winding_number(places, spacing[some])
        level = float(np.average(winding, weights=weight[some]))
        far.level = _local_levels(places, winding, ~solid[some], level)
        return far

    def level_at(self, x: Array) -> Array | float:
        """Return the winding number that parts inside and outside around places, (m, 3)."""
        return self.level.at(x)

    def winding_number(self, x: Array, spacing: Array) -> Array:
        """Return the winding number at queries `x`, (m,), smoothed according to the spacing."""
        return np.asarray(self._tree.winding(self._dipoles, x, WIDTH * spacing, OPENING))


def dipole_areas(samples: Array, spacing: Array) -> Array:
    """Return the area around each sample, (n,); in large clouds, consecutive samples share one.

    Parameters
    ----------
    samples : (n, 3) float64
        Samples in Morton order.
    spacing : (n,) float64
        Local distance between them, which limits the area.
    """
    few = min(1 + len(samples) // PLACES, ALIKE)
    places = np.ascontiguousarray(samples[few // 2 :: few])
    areas = neighborhood_areas(places, KdTree(samples, thread_count()))
    areas = np.repeat(areas, few)[np.minimum(np.arange(len(samples)), few * len(areas) - 1)]
    # Lengths are compared: the square of a spacing as long as the user's voxels may overflow.
    return np.asarray(np.minimum(np.sqrt(areas), LONE * spacing) ** 2)


def _local_levels(places: Array, winding: Array, sheet: NDArray[np.bool_], level: float) -> Level:
    """Return the level of all, and the differences from it on sheets and in rooms."""
    rows = np.linspace(0, len(places) - 1, min(len(places), LEVELS)).astype(np.int64)
    some, k = np.ascontiguousarray(places[rows]), min(AVERAGED, len(places))
    near = KdTree(places, thread_count()).query(some, k, np.inf)[1]
    off = winding[near].mean(axis=1) - level
    off = sheet[near].mean(axis=1) * (off - np.clip(off, -SAME, SAME))
    return Level(level, some, off) if off.any() else Level(level, some[:0], off[:0])
