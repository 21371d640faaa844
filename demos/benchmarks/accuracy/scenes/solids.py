"""What rays can meet, from outside and from inside."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Place = tuple[float, float, float]

NEAR = 1e-6
"""Distance from the station, in metres, below which nothing is met."""


class Solid(Protocol):
    """A surface that rays meet on either side."""

    def meet(self, origins: Array, rays: Array) -> tuple[Array, Array]:
        """Follow rays until they meet the surface.

        Parameters
        ----------
        origins, rays : (n, 3) float64
            Starts and unit directions.

        Returns
        -------
        distance : (n,) float64
            Inf where a ray misses.
        normals : (n, 3) float64
            Unit normals of either sign where it does not.
        """


@dataclass(frozen=True)
class Box:
    """A box of so many metres a side, turned about z by an angle in degrees."""

    middle: Place
    size: Place
    turn: float = 0.0

    def meet(self, origins: Array, rays: Array) -> tuple[Array, Array]:
        """See :class:`Solid`."""
        c, s = np.cos(np.radians(self.turn)), np.sin(np.radians(self.turn))
        axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        start, ray, half = (
            (origins - self.middle) @ axes.T,
            rays @ axes.T,
            0.5 * np.array(self.size),
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (-half - start) / ray, (half - start) / ray
        enter, leave = np.fmin(a, b), np.fmax(a, b)
        first, last = enter.max(axis=1), leave.min(axis=1)
        outside = first > NEAR
        distance = np.where(outside, first, last)
        met = (first <= last) & (last > NEAR)
        face = np.where(outside, enter.argmax(axis=1), leave.argmin(axis=1))
        return np.where(met, distance, np.inf), axes[face]


@dataclass(frozen=True)
class Ball:
    """A ball."""

    middle: Place
    radius: float

    def meet(self, origins: Array, rays: Array) -> tuple[Array, Array]:
        """See :class:`Solid`."""
        start = origins - self.middle
        a, b = np.ones(len(rays)), np.einsum("nd,nd->n", start, rays)
        both = _roots(a, b, (start**2).sum(axis=1) - self.radius**2)
        distance = np.where(both > NEAR, both, np.inf).min(axis=0)
        return distance, (start + _finite(distance)[:, None] * rays) / self.radius


@dataclass(frozen=True)
class Pipe:
    """A tube between two places, open at its ends."""

    start: Place
    end: Place
    radius: float

    def meet(self, origins: Array, rays: Array) -> tuple[Array, Array]:
        """See :class:`Solid`."""
        axis = np.subtract(self.end, self.start)
        length = float(np.linalg.norm(axis))
        axis = axis / length
        start = origins - self.start
        across, ray = start - np.outer(start @ axis, axis), rays - np.outer(rays @ axis, axis)
        a, b = (ray**2).sum(axis=1), np.einsum("nd,nd->n", across, ray)
        both = _roots(a, b, (across**2).sum(axis=1) - self.radius**2)
        along = start @ axis + np.where(np.isfinite(both), both, 0.0) * (rays @ axis)
        met = (both > NEAR) & (along >= 0.0) & (along <= length)  # infinite ones change nothing
        distance = np.where(met, both, np.inf).min(axis=0)
        return distance, (across + _finite(distance)[:, None] * ray) / self.radius


@dataclass(frozen=True)
class Ground:
    """A surface z = height(x, y) within `reach` metres of the origin in x and in y."""

    height: Callable[[Array, Array], Array]
    reach: float

    def meet(self, origins: Array, rays: Array) -> tuple[Array, Array]:
        """See :class:`Solid`; steps along the rays, finer near the station, then bisection."""

        def above(t: Array) -> Array:
            x, y, z = (origins + t[:, None] * rays).T
            return np.asarray(z - self.height(x, y))

        far = 1.5 * self.reach + np.abs(origins).max(axis=1)
        low, high = np.zeros(len(rays)), np.zeros(len(rays))
        side, met = above(low) > 0.0, np.zeros(len(rays), bool)
        for share in np.linspace(0.0, 1.0, 401)[1:]:
            t = far * share**2
            crossed = ~met & ((above(t) > 0.0) != side)
            low, high = np.where(crossed | met, low, t), np.where(crossed, t, high)
            met |= crossed
        for _ in range(40):
            middle = 0.5 * (low + high)
            same = (above(middle) > 0.0) == side
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        x, y, _ = (origins + low[:, None] * rays).T
        met &= (np.maximum(np.abs(x), np.abs(y)) <= self.reach) & (low > NEAR)
        e = 1e-4  # metres
        slope_x = (self.height(x + e, y) - self.height(x - e, y)) / (2.0 * e)
        slope_y = (self.height(x, y + e) - self.height(x, y - e)) / (2.0 * e)
        normals = np.column_stack([-slope_x, -slope_y, np.ones(len(x))])
        return np.where(met, low, np.inf), unit(normals)


def unit(x: Array) -> Array:
    """Scale vectors, (..., 3), to length one."""
    return np.asarray(x / np.linalg.norm(x, axis=-1, keepdims=True))


def _roots(a: Array, half_b: Array, c: Array) -> Array:
    """Both roots, (2, n), of a x^2 + 2 half_b x + c; inf where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(half_b**2 - a * c)
        both = np.stack([(-half_b - root) / a, (-half_b + root) / a])
    return np.where(np.isfinite(both), both, np.inf)


def _finite(distance: Array) -> Array:
    return np.where(np.isfinite(distance), distance, 0.0)
