"""Two tooth crowns as implicit functions, and points drawn from them: inputs like the paper's.

The paper's scans are not public. These shapes have the features that make teeth difficult: a thin
edge next to a thick neck (incisor), cusps with deep narrow grooves between them (molar). Lengths
are in mm.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Implicit = Callable[[Array], Array]

STEP = 1e-4
"""Step of the central differences, in mm."""


@dataclass(frozen=True)
class Tooth:
    """A crown.

    Attributes
    ----------
    name : str
        incisor or molar.
    implicit : callable
        Maps (m, 3) queries to (m,) values, negative inside, about the distance near the surface.
    half_size : (3,) tuple of float
        Half the size of a box around the origin that contains the crown.
    """

    name: str
    implicit: Implicit
    half_size: tuple[float, float, float]

    def distance(self, x: Array) -> Array:
        """Return the distance, (m,), of queries near the surface from it, to first order."""
        return self.implicit(x) / np.linalg.norm(self._gradient(x), axis=1)

    def normals(self, x: Array) -> Array:
        """Return the outward unit normals at points on the surface, (m, 3)."""
        gradient = self._gradient(x)
        return gradient / np.linalg.norm(gradient, axis=1, keepdims=True)

    def sample(self, count: int, noise: float = 0.0, seed: int = 0) -> Array:
        """Draw points uniformly from the surface.

        Parameters
        ----------
        count : int
            Number of points.
        noise : float, default 0
            Standard deviation of each coordinate, in mm.
        seed : int, default 0
            Seed of the random numbers.

        Returns
        -------
        numpy.ndarray, shape (count, 3)
        """
        rng = np.random.default_rng(seed)
        half = np.asarray(self.half_size)
        # A thin shell of constant thickness has the same volume per area everywhere.
        thickness = 0.01 * half.min()
        found = np.empty((0, 3))
        while len(found) < count:
            x = rng.uniform(-half, half, (200_000, 3))
            x = x[np.abs(self.implicit(x)) < 20.0 * thickness]
            x = x[np.abs(self.distance(x)) < thickness]
            for _ in range(3):
                x = x - self.distance(x)[:, None] * self.normals(x)
            found = np.concatenate([found, x])
        return found[:count] + rng.normal(0.0, noise, (count, 3))

    def _gradient(self, x: Array) -> Array:
        columns = []
        for axis in range(3):
            step = np.zeros(3)
            step[axis] = STEP
            columns.append((self.implicit(x + step) - self.implicit(x - step)) / (2.0 * STEP))
        return np.stack(columns, axis=1)


def incisor() -> Tooth:
    """Return a shovel: wide and thin at the edge, thick at the neck, hollow at the back."""

    def implicit(p: Array) -> Array:
        x, y, z = p.T
        up = np.clip((z + 5.0) / 10.0, 0.0, 1.0)
        wide = 3.1 + 1.1 * up
        thick = 3.2 - 2.3 * up**1.3
        bend = 0.9 * up**2
        power = 2.6
        body = (
            np.abs(x / wide) ** power
            + np.abs((y - bend) / thick) ** power
            + np.abs(z / 5.2) ** (2.0 * power)
        ) ** (1.0 / power) - 1.0
        hollow = _ellipsoid(p, (0.0, -3.6, 1.6), (2.3, 2.7, 3.0))
        return _smooth_max(1.6 * body, -hollow, 0.35)

    return Tooth("incisor", implicit, (5.0, 4.5, 6.2))


def molar() -> Tooth:
    """Return a rounded block with five cusps and the grooves between them."""
    cusps = (
        (-2.6, -2.3, 2.0),
        (2.4, -2.4, 1.8),
        (-2.5, 2.3, 1.7),
        (2.2, 2.4, 1.6),
        (4.0, 0.3, 1.2),
    )

    def implicit(p: Array) -> Array:
        x, y, z = p.T
        narrow = 1.0 - 0.06 * np.clip(-z, 0.0, 4.0)
        block = 3.4 * (
            (
                np.abs(x / (4.9 * narrow)) ** 4
                + np.abs(y / (4.4 * narrow)) ** 4
                + np.abs((z + 0.8) / 3.2) ** 4
            )
            ** 0.25
            - 1.0
        )
        shape = block
        for a, b, c in cusps:
            shape = _smooth_min(shape, _ellipsoid(p, (a, b, c), (1.8, 1.7, 2.0)), 0.6)
        basin = _ellipsoid(p, (0.0, 0.0, 3.4), (1.9, 1.5, 1.9))
        shape = _smooth_max(shape, -basin, 0.5)
        for start, stop in (((-4.5, 0.0), (3.0, 0.0)), ((0.0, -4.6), (0.0, 4.6))):
            groove = _groove(p, start, stop, height=2.1, radius=0.45)
            shape = _smooth_max(shape, -groove, 0.3)
        return shape

    return Tooth("molar", implicit, (6.4, 5.6, 5.6))


def _ellipsoid(p: Array, center: tuple[float, ...], radii: tuple[float, ...]) -> Array:
    """Return the approximate distance from an ellipsoid."""
    local = (p - np.asarray(center)) / np.asarray(radii)
    return (np.linalg.norm(local, axis=1) - 1.0) * min(radii)


def _groove(
    p: Array, start: tuple[float, float], stop: tuple[float, float], height: float, radius: float
) -> Array:
    """Return the distance from a horizontal capsule."""
    a = np.array([*start, height])
    along = np.array([*stop, height]) - a
    share = np.clip((p - a) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(p - a - share[:, None] * along, axis=1) - radius


def _smooth_min(a: Array, b: Array, width: float) -> Array:
    """Polynomial smooth minimum (Quilez)."""
    share = np.clip(0.5 + 0.5 * (b - a) / width, 0.0, 1.0)
    return b + share * (a - b) - width * share * (1.0 - share)


def _smooth_max(a: Array, b: Array, width: float) -> Array:
    return -_smooth_min(-a, -b, width)
