"""Stage 8: one function for all space: local implicits near the data, winding number elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, WindingTree, evaluate_field, sort_morton
from o3d_sofnn.geometry.checks import check_stage
from o3d_sofnn.geometry.neighbors import neighborhood_areas
from o3d_sofnn.orientation.winding_normals import OPENING
from o3d_sofnn.rules.rule_base import RuleBase
from o3d_sofnn.threads import thread_count

if TYPE_CHECKING:
    from o3d_sofnn.implicit.units import LocalSurfaces

REACH = (0.75, 1.5)
"""Distances from the data, divided by the spacing, up to which only the local implicits count, and
above which only the winding number does."""


NOISY_REACH = 0.67
"""Factor of both distances where there is noise."""


CERTAIN = (0.2, 0.35)
"""Deviations of the winding number from its level up to which the local implicits are trusted, and
above which they are not: such a place is clearly inside or outside."""


WIDTH = 0.75
"""Smoothing width of the winding number, divided by the spacing."""


ACROSS = 16.0
"""How fast a noisy rule loses weight with the residual that neither noise nor chance explains: such
a rule lies across an edge, and the rules of the two faces are more accurate."""


UNEXPLAINED = 10.0
"""Upper limit of that residual."""


NEAREST = 16
"""Number of rules that are blended at one query."""


BLOCK = 2**18
"""Number of queries that are evaluated together."""


PLACES = 50_000
"""Number of samples that suffice to estimate the mean winding number of all."""


LONE = 8.0
"""Largest edge of the square that a sample covers, divided by the spacing. Without this limit, an
isolated clump of fewer points than the neighbours searched for would weigh as much as a room."""


ALIKE = 8
"""Largest number of consecutive samples that share one area."""


LEVELS, AVERAGED, NEAR_LEVELS = 2000, 64, 4
"""Places at which the level of the winding number is known, samples averaged at each, and how many
are blended. In a room or beside a sheet the winding number on the surface depends on how much
of the rest is seen from there: one level for all lost 38 % of the points of a street."""


SAME = 0.1
"""Difference from the level of all that is no difference."""


Evaluate = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
"""Type of a field: maps (m, 3) queries to (m,) values, negative inside, and (m,) support."""


class Field:
    """Signed distance-like function, negative inside, defined everywhere.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    surfaces : LocalSurfaces
        Their local implicits.
    samples : (n, 3) float64
        Points moved onto the surface, in Morton order.
    normals : (n, 3) float64
        Unit normals of the samples.
    spacing : (n,) float64
        Local distance between neighbouring samples, or the intended resolution if that is coarser.
    solid : (n,) bool
        True for samples on a solid, False for those on a sheet or in a room.
    """

    def __init__(
        self,
        rules: RuleBase,
        surfaces: LocalSurfaces,
        samples: NDArray[np.float64],
        normals: NDArray[np.float64],
        spacing: NDArray[np.float64],
        solid: NDArray[np.bool_],
    ) -> None:
        self.rules = rules
        self.surfaces = surfaces
        self.samples = samples
        self.normals = normals
        self.noisiness = float(np.median(rules.noisiness))
        self._reach = 1.0 + (NOISY_REACH - 1.0) * self.noisiness
        self._samples = KdTree(samples, thread_count())
        self._spacing = spacing
        self._view = rules.view(trust=trust(rules))
        # Lengths are compared: the square of a spacing as long as the user's voxels may overflow.
        weight = np.minimum(np.sqrt(self._areas(samples)), LONE * spacing) ** 2
        self._dipoles = weight[:, None] * normals
        self._far_tree = WindingTree(samples, weight, thread_count())
        # As in Poisson reconstruction, the level is the mean at the samples: 1/2 on closed data.
        some = slice(None, None, 1 + len(samples) // PLACES)
        on_samples = self.winding_number(np.ascontiguousarray(samples[some]), spacing[some])
        self.level = float(np.average(on_samples, weights=weight[some]))
        places = np.ascontiguousarray(samples[some])
        self._levels = self._local_levels(places, on_samples, ~solid[some])

    def _areas(self, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the area around each sample; in large clouds, consecutive samples share one."""
        few = min(1 + len(samples) // PLACES, ALIKE)
        places = np.ascontiguousarray(samples[few // 2 :: few])
        areas = neighborhood_areas(places, self._samples)
        return np.repeat(areas, few)[np.minimum(np.arange(len(samples)), few * len(areas) - 1)]

    def _local_levels(
        self,
        places: NDArray[np.float64],
        winding: NDArray[np.float64],
        sheet: NDArray[np.bool_],
    ) -> tuple[KdTree, NDArray[np.float64]] | None:
        """Differences of the level from that of all, at some places; None where there are none."""
        rows = np.linspace(0, len(places) - 1, min(len(places), LEVELS)).astype(np.int64)
        some, k = np.ascontiguousarray(places[rows]), min(AVERAGED, len(places))
        near = KdTree(places, thread_count()).query(some, k, np.inf)[1]
        off = winding[near].mean(axis=1) - self.level
        off = sheet[near].mean(axis=1) * (off - np.clip(off, -SAME, SAME))
        return (KdTree(some, thread_count()), off) if off.any() else None

    def level_at(self, x: NDArray[np.float64]) -> NDArray[np.float64] | float:
        """Winding number that parts inside and outside around places (m, 3)."""
        if self._levels is None:
            return self.level
        tree, off = self._levels
        distance, near = tree.query(x, min(NEAR_LEVELS, len(off)), np.inf)
        weight = 1.0 / np.maximum(distance, 1e-9) ** 2
        return np.asarray(self.level + (weight * off[near]).sum(axis=1) / weight.sum(axis=1))

    def winding_number(
        self, x: NDArray[np.float64], spacing: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the winding number at queries `x`, (m,), smoothed according to the spacing."""
        return np.asarray(self._far_tree.winding(self._dipoles, x, WIDTH * spacing, OPENING))

    def nearest(
        self, x: NDArray[np.float64], k: int
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return the distances to the `k` nearest samples, (m, k), and their indices."""
        k = min(k, len(self._spacing))
        distance, index = self._samples.query(x, k, np.inf)
        return np.asarray(distance), np.asarray(index)

    def spacing_at(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the spacing, (m,), of the samples nearest to queries (m, 3)."""
        return np.asarray(self._spacing[self._samples.query(x, 1, np.inf)[1][:, 0]])

    def __call__(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Evaluate the field.

        Parameters
        ----------
        x : (m, 3) float64
            Queries.

        Returns
        -------
        values : (m,) float64
            Values, negative inside, in the unit of the points.
        support : (m,) float64
            Support by the data: 1 on the data, 0 far from them.
        """
        # The kernels share work between neighbours.
        order = np.asarray(sort_morton(np.ascontiguousarray(x), thread_count())[1])
        values, support = np.empty(len(x)), np.empty(len(x))
        for start in range(0, len(x), BLOCK):  # about ten numbers per query are in memory
            block = order[start : start + BLOCK]
            values[block], support[block] = self._evaluate(np.ascontiguousarray(x[block]))
        check_stage("field", values=values)
        return values, support

    def _evaluate(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        # Beyond the reach of the widest spacing, the search ends early with an infinite distance.
        limit = REACH[1] * float(self._spacing.max())
        distance, nearest = self._samples.query(x, 1, limit)
        spacing = self._spacing[np.minimum(nearest[:, 0], len(self._spacing) - 1)]
        support = fade(distance[:, 0] / spacing, *REACH)
        share = fade(distance[:, 0] / (self._reach * spacing), *REACH)
        excess = self.level_at(x) - self.winding_number(x, spacing)
        weight = share * fade(np.abs(excess), *CERTAIN)
        far = spacing * excess
        values = far.copy()
        near = np.flatnonzero(share > 0.0)
        local = evaluate_field(
            self._view,
            self.surfaces.terms,
            self.surfaces.n_terms,
            np.ascontiguousarray(x[near]),
            min(NEAREST, len(self.rules)),
        )
        agree = local * far[near] > 0.0
        blend = weight[near] * local + (1.0 - weight[near]) * far[near]
        values[near] = np.where(agree, local, blend)
        return values, support


def trust(rules: RuleBase) -> NDArray[np.float64]:
    """Return a factor of each rule's quality in the blend, (r,), low across edges of noisy data."""
    chance = np.sqrt(2.0 / rules.n_neighbors)
    unexplained = np.clip(rules.excess - chance, 0.0, UNEXPLAINED)
    return np.asarray(np.exp(-ACROSS * rules.noisiness * unexplained))


def fade(x: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """Return a smooth step from 1 at `low` to 0 at `high`."""
    t = np.clip((high - x) / (high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))
