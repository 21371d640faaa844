"""The rule base: what a rule is, and what follows from its parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, RuleView
from o3d_sofnn.sampling.local_fit import (
    RADIUS,
    Neighborhoods,
    Quadrics,
    fit_quadrics,
    spacing_of,
)
from o3d_sofnn.sampling.typical_data import RULES_PER_NEIGHBORHOOD


def fit_rules(
    tree: KdTree,
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    where: Neighborhoods,
    n_threads: int,
    confidence: NDArray[np.float64] | None = None,
) -> RuleBase:
    """Make a rule of each local fit (Algorithm 1, steps 3 and 5).

    Parameters
    ----------
    tree, points, normals, where, n_threads
        As in :func:`o3d_sofnn.sampling.local_fit.fit_quadrics`.
    confidence : (r,) float64, optional
        Of the sides, kept with the rules; 1 when not given.

    Returns
    -------
    RuleBase
    """
    quadrics = fit_quadrics(tree, points, normals, where, n_threads)
    confidence = np.ones(len(quadrics)) if confidence is None else confidence
    return RuleBase(**vars(quadrics), noise=where.noise, confidence=confidence)


NOISE_TOLERANCE = 1.4
"""Width of the membership in the residual, over the noise level."""


SHAPE_TOLERANCE = 0.02
"""The same over the radius of the fit: what a quadric leaves of a clean shape."""


USUAL = 0.67
"""Residual of a good fit over its tolerance."""


NOISY = 0.2
"""Noise over spacing from which on it is noise."""


UNCERTAIN = 3.0
"""Curvature that noise may cause, over noise / radius / sqrt(points of the fit)."""


FLAT = 0.02
"""Curvature times radius that is none."""


LONGEST = 2.0
"""Largest stretch of a neighbourhood."""


@dataclass(frozen=True)
class RuleBase(Quadrics):
    """Rules: an elliptical region of space each, with a quadric as its consequent.

    A rule is a fit and what is known of its region; its width in the tangent plane, eq. (11), is
    half the radius of the fit.

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
        """Area of surface that each rule stands for, (r,)."""
        return np.asarray(np.pi * (self.radius / RADIUS) ** 2 / RULES_PER_NEIGHBORHOOD)

    @property
    def spacing(self) -> NDArray[np.float64]:
        """Edge of the square that one point of the neighbourhood covers, (r,)."""
        return spacing_of(self.radius, self.n_neighbors)

    @property
    def noisiness(self) -> NDArray[np.float64]:
        """From 0, where the noise level is shape that quadrics miss, to 1, where it is noise."""
        return np.minimum(self.noise / (NOISY * self.spacing), 1.0)

    @property
    def tolerance(self) -> NDArray[np.float64]:
        """Width of the membership in the residual, (r,), in the unit of the points."""
        return np.maximum(NOISE_TOLERANCE * self.noise, SHAPE_TOLERANCE * self.radius)

    @property
    def excess(self) -> NDArray[np.float64]:
        """Squared residual in excess of the usual one, over that, (r,)."""
        return np.asarray((self.residual / (USUAL * self.tolerance)) ** 2 - 1.0)

    @property
    def quality(self) -> NDArray[np.float64]:
        """Weight of each rule in the inference: low where the quadric does not fit, (r,)."""
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
        # A curvature that noise alone may cause says nothing about the direction.
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

    def view(
        self,
        n_threads: int,
        gates: NDArray[np.float64] | None = None,
        neurons: NDArray[np.float64] | None = None,
        trust: NDArray[np.float64] | None = None,
    ) -> RuleView:
        """Copy the rules for the native kernels.

        Parameters
        ----------
        n_threads : int
            Threads.
        gates, neurons : (r, m, 2) and (m, 3, 3) float64, optional
            What the off-line rules say of each rule, and the part of them that belongs to places.
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
            n_threads,
        )

    def rows(self, index: NDArray[np.bool_]) -> RuleBase:
        """Pick some of the rules."""
        return RuleBase(**{name: value[index] for name, value in vars(self).items()})

    def joined(self, other: RuleBase) -> RuleBase:
        """Both rule bases, this one first."""
        return joined(self, other)


Table = TypeVar("Table")


def joined(first: Table, second: Table) -> Table:
    """Rows of two tables of one kind, those of the first one first."""
    a, b = vars(first), vars(second)
    return type(first)(**{name: np.concatenate([a[name], b[name]]) for name in a})
