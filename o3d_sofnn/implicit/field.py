"""Stage 8: one function for all space: local implicits near the data, winding number elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, evaluate_field, sort_morton
from o3d_sofnn.geometry.checks import check_stage
from o3d_sofnn.implicit.far_field import FarField
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


ACROSS = 16.0
"""How fast a noisy rule loses weight with the residual that neither noise nor chance explains: such
a rule lies across an edge, and the rules of the two faces are more accurate."""


UNEXPLAINED = 10.0
"""Upper limit of that residual."""


NEAREST = 16
"""Number of rules that are blended at one query."""


BLOCK = 2**18
"""Number of queries that are evaluated together."""


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
    far : FarField
        The winding number and its level.
    noisiness : float, optional
        From 0 to 1, if the noise level is noise; None takes the median of the rules.
    """

    def __init__(
        self,
        rules: RuleBase,
        surfaces: LocalSurfaces,
        samples: NDArray[np.float64],
        normals: NDArray[np.float64],
        spacing: NDArray[np.float64],
        far: FarField,
        noisiness: float | None = None,
    ) -> None:
        self.rules = rules
        self.surfaces = surfaces
        self.samples = samples
        self.normals = normals
        self.far = far
        self.noisiness = float(np.median(rules.noisiness)) if noisiness is None else noisiness
        self._reach = 1.0 + (NOISY_REACH - 1.0) * self.noisiness
        self._samples = KdTree(samples, thread_count())
        self._spacing = spacing
        self._view = rules.view(trust=trust(rules))

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
        distance, spacing = self.near(x)
        return self.blend(x, distance, spacing, self.far.winding_number(x, spacing))

    def near(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the distance to the nearest sample, (m,), and its spacing.

        Beyond the reach of the widest spacing the search ends early, with an infinite distance.
        """
        limit = REACH[1] * float(self._spacing.max())
        distance, nearest = self._samples.query(x, 1, limit)
        spacing = self._spacing[np.minimum(nearest[:, 0], len(self._spacing) - 1)]
        return np.asarray(distance[:, 0]), np.asarray(spacing)

    def blend(
        self,
        x: NDArray[np.float64],
        distance: NDArray[np.float64],
        spacing: NDArray[np.float64],
        winding: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Blend the local implicits with the winding number.

        Parameters
        ----------
        x : (m, 3) float64
            Queries; the result at one does not depend on the others.
        distance, spacing : (m,) float64
            What :meth:`near` says of them.
        winding : (m,) float64
            Winding number at the queries.

        Returns
        -------
        values, support : (m,) float64
        """
        support = fade(distance / spacing, *REACH)
        share = fade(distance / (self._reach * spacing), *REACH)
        excess = self.far.level_at(x) - winding
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
