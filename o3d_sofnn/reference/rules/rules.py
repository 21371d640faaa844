"""The rules that twins infer from: twin of the class ``RuleView`` of ``native/rules/rules.hpp``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST = 1e-15
"""Smallest radius, divided by the size of the rule base, and tolerance, divided by the radius."""


class Rules(NamedTuple):
    """The arrays of a rule base, one row a rule."""

    centers: Array
    """Centres, (r, 3)."""
    frames: Array
    """Two tangents and the normal, (r, 3, 3)."""
    coefficients: Array
    """Quadrics, with lengths divided by the radius, (r, 6)."""
    radius: Array
    """Radii of the fits, in the unit of the points, (r,)."""
    stretch: Array
    """Length of the neighbourhoods divided by their width, (r,)."""
    tolerance: Array
    """Width of the Gaussian in the residual, in the unit of the points, (r,)."""
    quality: Array
    """Weight of each rule, 0 to 1, (r,)."""

    gates: Array | None = None
    """Logarithm of the firing strength and consequent of each off-line neuron, (r, m, 2)."""
    neurons: Array | None = None
    """Centres, inverse widths and slopes of these by the inputs of the place, (m, 3, 3)."""

    def bounded(self) -> Rules:
        """Rules of which none is smaller than the rounding of its coordinates."""
        size = np.linalg.norm(self.centers - self.centers[0], axis=1).max()
        radius = np.maximum(self.radius, max(LEAST * size, 1e-100))
        return self._replace(
            radius=radius,
            stretch=np.maximum(self.stretch, 1.0),
            tolerance=np.maximum(self.tolerance, LEAST * radius),
        )

    def rows(self, index: NDArray[np.int64]) -> Rules:
        """Pick the rules of these numbers."""
        gates = None if self.gates is None else self.gates[index]
        return Rules(
            self.centers[index],
            self.frames[index],
            self.coefficients[index],
            self.radius[index],
            self.stretch[index],
            self.tolerance[index],
            self.quality[index],
            gates,
            self.neurons,
        )

    def trust(self, residual: Array, lean: Array, reach: Array) -> Array:
        """Logarithm of the trust in each rule, (r,): the off-line rules with linear consequents.

        Parameters
        ----------
        residual : (r,) float64
            Distance to the quadric, divided by the radius.
        lean : (r,) float64
            Cosine between the normal of the quadric and the side.
        reach : (r,) float64
            Squared distance in the tangent plane, divided by the radius.
        """
        if self.gates is None or self.neurons is None:
            return np.zeros(len(self.centers))
        root, reach = np.minimum(np.abs(residual), 1.0) ** 0.25, np.minimum(reach, 4.0)
        centers, inverse_widths, slopes = self.neurons.transpose(1, 0, 2)
        offset = np.stack([root, lean, reach], axis=1)[:, None] - centers
        firing = self.gates[:, :, 0] - 0.5 * ((offset * inverse_widths) ** 2).sum(axis=2)
        said = self.gates[:, :, 1] + (offset * slopes).sum(axis=2)
        basis = np.exp(firing - firing.max(axis=1, keepdims=True))
        return np.asarray((basis * said).sum(axis=1) / basis.sum(axis=1))  # Eq. (7) and (9)
