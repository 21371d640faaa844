"""The rule base: the parameters of a rule, and quantities derived from them."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, RuleView
from o3d_sofnn.sampling.local_fit import (
    RADIUS,
    RULES_PER_NEIGHBORHOOD,
    Neighborhoods,
    Quadrics,
    fit_quadrics,
    spacing_of,
)
from o3d_sofnn.threads import thread_count


def fit_rules(
    tree: KdTree,
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    where: Neighborhoods,
    confidence: NDArray[np.float64] | None = None,
) -> RuleBase:
    """Make a rule of each local fit (Algorithm 1, steps 3 and 5).

    Parameters
    ----------
    tree, points, normals, where
        As in :func:`o3d_sofnn.sampling.local_fit.fit_quadrics`.
    confidence : (r,) float64, optional
        Confidence in the sides, stored with the rules; 1 if not given.

    Returns
    -------
    RuleBase
    """
    quadrics = fit_quadrics(tree, points, normals, where)
    confidence = np.ones(len(quadrics)) if confidence is None else confidence
    return RuleBase(**columns(quadrics), noise=where.noise, confidence=confidence)


NOISE_TOLERANCE = 1.4
"""Width of the membership in the residual, divided by the noise level."""


SHAPE_TOLERANCE = 0.02
"""The same width divided by the radius of the fit: the residual of a quadric on a clean shape."""


USUAL = 0.67
"""Residual of a good fit, divided by its tolerance."""


NOISY = 0.2
"""Noise level, divided by the spacing, above which it is certainly noise, not shape."""


UNCERTAIN = 3.0
"""Curvature that noise may cause, divided by ``noise / radius / sqrt(points of the fit)``."""


FLAT = 0.02
"""Product of curvature and radius below which a fit counts as flat."""


LONGEST = 2.0
"""Largest stretch of a neighbourhood."""


@dataclass(frozen=True)
class RuleBase(Quadrics):
    """Rules: elliptical regions of space with quadrics as their consequents.

    A rule is a fit with properties of its region; its width in the tangent plane, eq. (11), is half
    the radius of the fit.

    Attributes
    ----------
    noise : (r,) float64
        Noise level of the region.
    confidence : (r,) float64
        Confidence in the side that the normal faces, 0 to 1.
    """

    noise: NDArray[np.float64]
    confidence: NDArray[np.float64]

    @property
    def areas(self) -> NDArray[np.float64]:
        """Area of surface that each rule represents, (r,)."""
        return np.asarray(np.pi * (self.radius / RADIUS) ** 2 / RULES_PER_NEIGHBORHOOD)

    @property
    def spacing(self) -> NDArray[np.float64]:
        """Edge of the square that one point of the neighbourhood covers, (r,)."""
        return spacing_of(self.radius, self.n_neighbors)

    @property
    def noisiness(self) -> NDArray[np.float64]:
        """From 0, if the noise level is shape that quadrics miss, to 1, if it is noise, (r,)."""
        return np.minimum(self.noise / (NOISY * self.spacing), 1.0)

    @property
    def tolerance(self) -> NDArray[np.float64]:
        """Width of the membership in the residual, (r,), in the unit of the points."""
        return np.maximum(NOISE_TOLERANCE * self.noise, SHAPE_TOLERANCE * self.radius)

    @property
    def excess(self) -> NDArray[np.float64]:
        """Excess of the squared residual, divided by its typical value, (r,)."""
        return np.asarray((self.residual / (USUAL * self.tolerance)) ** 2 - 1.0)

    @property
    def quality(self) -> NDArray[np.float64]:
        """Weight of each rule in the inference, low if the quadric does not fit, (r,)."""
        return np.asarray(np.exp(-0.5 * np.minimum(self.residual / self.tolerance, 30.0) ** 2))

    @property
    def ellipses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Direction of strongest curvature, (r, 3), and stretch along the other one, (r,)."""
        c = self.coefficients
        half = 0.5 * np.arctan2(c[:, 4], c[:, 3] - c[:, 5])
        half = np.where(c[:, 3] + c[:, 5] < 0.0, half + 0.5 * np.pi, half)
        across = (
            np.cos(half)[:, None] * self.frames[:, 0] + np.sin(half)[:, None] * self.frames[:, 1]
        )
        # A curvature that noise alone may cause is no evidence of a direction.
        floor = UNCERTAIN * self.noise / self.radius / np.sqrt(self.n_neighbors) + FLAT
        weak, strong = np.sort(0.5 * self.radius[:, None] * np.abs(self.curvatures)).T
        return across, np.clip(((strong + floor) / (weak + floor)) ** 0.5, 1.0, LONGEST)

    def moved(self, scale: float, offset: NDArray[np.float64]) -> RuleBase:
        """Return the rules in coordinates ``scale * x + offset``."""
        return replace(
            self,
            centers=scale * self.centers + offset,
            radius=scale * self.radius,
            residual=scale * self.residual,
            noise=scale * self.noise,
        )

    @cached_property
    def center_tree(self) -> KdTree:
        """Tree of the centres."""
        return KdTree(self.centers, thread_count())

    @cached_property
    def foot_tree(self) -> KdTree:
        """Tree of the feet."""
        return KdTree(self.feet, thread_count())

    @cached_property
    def plain_view(self) -> RuleView:
        """The rules for the native kernels, without the off-line rules and as they are trusted."""
        return self.view()

    def view(
        self,
        gates: NDArray[np.float64] | None = None,
        neurons: NDArray[np.float64] | None = None,
        trust: NDArray[np.float64] | None = None,
    ) -> RuleView:
        """Copy the rules for the native kernels.

        Parameters
        ----------
        gates, neurons : (r, m, 2) and (m, 3, 3) float64, optional
            Part of the off-line rules that depends on the rule, and part that depends on the query.
        trust : (r,) float64, optional
            Factor of the quality of each rule.

        Returns
        -------
        RuleView
        """
        return RuleView(
            self.centers,
            np.ascontiguousarray(self.frames),
            np.ascontiguousarray(self.coefficients),
            self.radius,
            self.stretch,
            self.tolerance,
            self.quality if trust is None else self.quality * trust,
            gates,
            neurons,
            thread_count(),
        )

    def rows(self, index: NDArray[np.bool_]) -> RuleBase:
        """Return the rules in a mask, (r,) bool."""
        return RuleBase(**{name: value[index] for name, value in columns(self).items()})

    def joined(self, other: RuleBase) -> RuleBase:
        """Return both rule bases joined, this one first."""
        return joined(self, other)


def columns(table: Any) -> dict[str, NDArray[Any]]:
    """Return the arrays of a table (a dataclass of arrays with as many rows each) by name."""
    return {field.name: getattr(table, field.name) for field in fields(table)}


Table = TypeVar("Table")


def joined(first: Table, second: Table) -> Table:
    """Join the rows of two tables of the same type, the first one first."""
    a, b = columns(first), columns(second)
    return type(first)(**{name: np.concatenate([a[name], b[name]]) for name in a})
