"""Standardised units: rules are learnt in them, and kept and shown in the user's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from o3d_sofnn.sofnn.neurons import Array, Neurons


@dataclass
class Moments:
    """Running mean and sum of squared deviations, column by column (Welford 1962)."""

    count: int
    mean: Array
    squares: Array

    @classmethod
    def of(cls, values: Array) -> Moments:
        """Take the moments of (n, d) values."""
        mean = values.mean(axis=0)
        return cls(len(values), mean, np.sum((values - mean) ** 2, axis=0))

    def add(self, value: Array) -> None:
        """Take one more (d,) value into account."""
        self.count += 1
        gap = value - self.mean
        self.mean = self.mean + gap / self.count
        self.squares = self.squares + gap * (value - self.mean)

    def deviation(self) -> Array:
        """Give the (d,) standard deviation; a column that does not vary has unit one."""
        deviation = np.sqrt(self.squares / self.count)
        # Rounding makes the deviation of equal values a little more than zero.
        varies = deviation > 1e-14 * np.abs(self.mean)
        return np.where(varies, deviation, 1.0)


@dataclass(frozen=True)
class Scaling:
    """Linear map between the user's units and standardised ones.

    Inputs are scaled column by column; outputs by one number, so that the system error,
    a distance between output vectors, keeps its meaning.
    """

    x_mean: Array
    x_scale: Array
    y_mean: Array
    y_scale: float

    @classmethod
    def of(cls, x: Moments, y: Moments) -> Scaling:
        """Take the scaling that gives inputs unit deviation and outputs unit total deviation."""
        total = float(np.sqrt(np.sum(y.squares) / y.count))
        varies = total > 1e-14 * float(np.linalg.norm(y.mean))
        return cls(x.mean, x.deviation(), y.mean, total if varies else 1.0)

    def inputs(self, x: Array) -> Array:
        """Standardise inputs."""
        return (x - self.x_mean) / self.x_scale

    def outputs(self, y: Array) -> Array:
        """Standardise outputs."""
        return (y - self.y_mean) / self.y_scale

    def standardise(self, neurons: Neurons) -> Neurons:
        """Express rules in standardised units."""
        coefficients = neurons.coefficients / self.y_scale
        coefficients[0] -= self.y_mean / self.y_scale
        return Neurons(self.inputs(neurons.centers), neurons.widths / self.x_scale, coefficients)

    def restore(self, neurons: Neurons) -> Neurons:
        """Express standardised rules in the user's units."""
        coefficients = neurons.coefficients * self.y_scale
        coefficients[0] += self.y_mean
        centers = neurons.centers * self.x_scale + self.x_mean
        return Neurons(centers, neurons.widths * self.x_scale, coefficients)
