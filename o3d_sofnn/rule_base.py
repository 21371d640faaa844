"""The rule base: what a rule is, and what follows from its parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from . import _kernels
from .experience import Experience
from .local_fit import RADIUS, spacing_of
from .rows import joined
from .vectors import unit

RULES_PER_NEIGHBORHOOD = 8.0
"""Rules whose centres lie in the neighbourhood of one fit: how far neighbouring fits overlap."""
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
class RuleBase:
    """Rules: an elliptical region of space each, with a quadric as its consequent.

    In the frame of rule ``j`` with lengths over its radius, the surface is
    ``h = c0 + c1 u + c2 v + c3 u^2 + c4 u v + c5 v^2``, and the region is bounded by
    ``s u^2 + v^2 / s = 1`` with its stretch ``s``.

    Attributes
    ----------
    centers : (r, 3) float64
        Origins of the frames, in the unit of the points.
    frames : (r, 3, 3) float64
        Rows: two tangents and the normal of the fitted plane.
    coefficients : (r, 6) float64
        Consequent quadric, dimensionless.
    radius : (r,) float64
        Radius of the fitted neighbourhood; the tangential width is half of it.
    stretch : (r,) float64
        How many times longer than wide the neighbourhood is.
    residual : (r,) float64
        Root-mean-square residual of the fit.
    support : (r,) float64
        Share of the neighbourhood that faces the side of the rule, 0 to 1.
    noise : (r,) float64
        Noise level of the region.
    n_neighbors : (r,) int64
        Points that the fit saw.
    confidence : (r,) float64
        Confidence in the side that the normal faces, 0 to 1.
    """

    centers: NDArray[np.float64]
    frames: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    radius: NDArray[np.float64]
    stretch: NDArray[np.float64]
    residual: NDArray[np.float64]
    support: NDArray[np.float64]
    noise: NDArray[np.float64]
    n_neighbors: NDArray[np.int64]
    confidence: NDArray[np.float64]

    def __len__(self) -> int:
        """Return the number of rules."""
        return len(self.centers)

    @property
    def feet(self) -> NDArray[np.float64]:
        """Centres moved onto their quadrics, (r, 3)."""
        height = self.radius * self.coefficients[:, 0]
        return self.centers + height[:, None] * self.frames[:, 2]

    @property
    def normals(self) -> NDArray[np.float64]:
        """Unit normals of the quadrics at the feet, (r, 3)."""
        c = self.coefficients
        n = self.frames[:, 2] - c[:, 1:2] * self.frames[:, 0] - c[:, 2:3] * self.frames[:, 1]
        return unit(n)

    @property
    def curvatures(self) -> NDArray[np.float64]:
        """Principal curvatures at the feet, (r, 2), smaller first, positive where convex."""
        c = self.coefficients / self.radius[:, None]
        mean = -(c[:, 3] + c[:, 5])
        spread = np.hypot(c[:, 3] - c[:, 5], c[:, 4])
        return np.stack([mean - spread, mean + spread], axis=1)

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

    def facing(self, side: NDArray[np.float64]) -> RuleBase:
        """Turn every rule whose normal has a negative product with its row of `side`."""
        sign = np.where(np.einsum("rd,rd->r", self.normals, side) < 0, -1.0, 1.0)
        frames = self.frames * np.stack([np.ones_like(sign), sign, sign], axis=1)[:, :, None]
        flip = np.array([-1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
        coefficients = np.where(sign[:, None] < 0, self.coefficients * flip, self.coefficients)
        return replace(self, frames=frames, coefficients=coefficients)

    def raised(self, height: NDArray[np.float64]) -> RuleBase:
        """Move each consequent along the normal of its frame, (r,) heights."""
        coefficients = self.coefficients.copy()
        coefficients[:, 0] += height / self.radius
        return replace(self, coefficients=coefficients)

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
        experience: Experience | None = None,
        trust: NDArray[np.float64] | None = None,
    ) -> _kernels.RuleView:
        """Copy the rules for the native kernels.

        Parameters
        ----------
        n_threads : int
            Threads.
        experience : Experience, optional
            Off-line rules and what they say of each rule.
        trust : (r,) float64, optional
            Factor of the quality of each rule.

        Returns
        -------
        RuleView
        """
        gates = None if experience is None else experience.gates(self)
        return _kernels.RuleView(
            self.centers,
            np.ascontiguousarray(self.frames),
            np.ascontiguousarray(self.coefficients),
            self.radius,
            self.stretch,
            self.tolerance,
            self.quality if trust is None else self.quality * trust,
            gates,
            None if experience is None else experience.neurons,
            n_threads,
        )

    def rows(self, index: NDArray[np.bool_]) -> RuleBase:
        """Pick some of the rules."""
        return RuleBase(**{name: value[index] for name, value in vars(self).items()})

    def joined(self, other: RuleBase) -> RuleBase:
        """Both rule bases, this one first."""
        return joined(self, other)
