"""Rays of scanners and cameras, their errors, and the scans that come of both."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from scenes.solids import Array, Solid, unit

JUMP = 0.05
"""Difference of the ranges of neighbouring rays, over the nearer one, that makes mixed pixels."""

GRAZING = 0.2
"""Cosine of incidence below which twice as many rays are lost."""


@dataclass(frozen=True)
class Rays:
    """Rays of one station or of several flights, row by row.

    Attributes
    ----------
    origins, directions : (rows, columns, 3) float64
        Unit directions.
    depth : (rows, columns) float64
        Depth over range: 1 for scanners, which measure ranges.
    """

    origins: Array
    directions: Array
    depth: Array


@dataclass(frozen=True)
class Sensor:
    """Errors of a sensor, all along the ray; lengths in metres at a range of one metre.

    Attributes
    ----------
    noise : float
        Standard deviation of the range.
    step : float
        The range is a multiple of this (with a `growth` of 2: the reciprocal of the depth is).
    growth : float
        Noise and step grow with this power of the range: 0 for lasers, 2 for depth cameras.
    mixed : float
        Share of the rays beside a jump whose range is a mean of both sides: mixed pixels.
    dropouts : float
        Share of the rays that do not come back; twice as many under a grazing angle.
    """

    noise: float = 0.0
    step: float = 0.0
    growth: float = 0.0
    mixed: float = 0.0
    dropouts: float = 0.0


@dataclass(frozen=True)
class Scan:
    """What was measured, and the truth.

    Attributes
    ----------
    points, normals, stations : (n, 3) float64
        Points, unit normals of the sides that were seen, and where from.
    stray : (n,) bool
        Points that lie on no surface.
    """

    points: Array
    normals: Array
    stations: Array
    stray: NDArray[np.bool_]

    def taken(self, rows: NDArray[np.int64] | NDArray[np.bool_]) -> Scan:
        """Return some rows."""
        return Scan(self.points[rows], self.normals[rows], self.stations[rows], self.stray[rows])

    def flipped(self, normals: Array) -> float:
        """Share of the points on surfaces whose normal, (n, 3), faces away from the side seen."""
        against = np.einsum("nd,nd->n", normals, self.normals) < 0.0
        return float(against[~self.stray].mean())


def joined(scans: Sequence[Scan]) -> Scan:
    """Return the points of several scans together."""
    return Scan(
        np.concatenate([scan.points for scan in scans]),
        np.concatenate([scan.normals for scan in scans]),
        np.concatenate([scan.stations for scan in scans]),
        np.concatenate([scan.stray for scan in scans]),
    )


def tripod(
    station: Sequence[float], columns: int, rows: int, low: float = -60.0, high: float = 90.0
) -> Rays:
    """Rays of a scanner that turns about z: equal angles, between `low` and `high` degrees."""
    turn = np.radians(np.linspace(0.0, 360.0, columns, endpoint=False))[None, :]
    lift = np.radians(low + (high - low) / rows * (np.arange(rows) + 0.5))[:, None]
    flat = np.cos(lift)
    up = np.broadcast_to(np.sin(lift), (rows, columns))
    rays = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=-1)
    return Rays(np.broadcast_to(station, rays.shape), rays, np.ones((rows, columns)))


def rings(station: Sequence[float], columns: int, rows: int = 32) -> Rays:
    """Rays of a spinning scanner on a car: few rings, from 25 degrees down to 15 degrees up."""
    return tripod(station, columns, rows, -25.0, 15.0)


def camera(
    station: Sequence[float], target: Sequence[float], columns: int, rows: int, view: float = 57.0
) -> Rays:
    """Rays of a depth camera that looks at a target: a lattice of pixels, `view` degrees wide."""
    ahead = unit(np.subtract(target, station))
    right = unit(np.cross(ahead, [0.0, 0.0, 1.0]))
    half = np.tan(np.radians(0.5 * view))
    x = half * np.linspace(-1.0, 1.0, columns)[None, :, None]
    y = half * rows / columns * np.linspace(1.0, -1.0, rows)[:, None, None]
    rays = ahead + x * right + y * np.cross(right, ahead)
    depth = 1.0 / np.linalg.norm(rays, axis=-1)
    return Rays(np.broadcast_to(station, rays.shape), unit(rays), depth)


def strips(
    height: float, reach: float, columns: int, rows: int, flights: int = 2, view: float = 40.0
) -> Rays:
    """Rays of flights along y: a fan across, `view` degrees wide, from each of the places."""
    fan = np.radians(np.linspace(-0.5 * view, 0.5 * view, columns))
    down = np.stack([np.sin(fan), np.zeros(columns), -np.cos(fan)], axis=1)
    x = reach * ((2.0 * np.arange(flights) + 1.0) / flights - 1.0)
    y = np.linspace(-reach, reach, rows)
    places = np.stack(np.broadcast_arrays(x[:, None], y, height), axis=-1).reshape(-1, 1, 3)
    shape = (len(places), columns, 3)
    return Rays(np.broadcast_to(places, shape), np.broadcast_to(down, shape), np.ones(shape[:2]))


def cast(solids: Sequence[Solid], rays: Rays, sensor: Sensor | None = None, seed: int = 0) -> Scan:
    """Send rays out; those that meet nothing are missing from the scan, in the order of rays.

    Parameters
    ----------
    solids : sequence of Solid
        The scene.
    rays : Rays
        What :func:`tripod`, :func:`camera`, :func:`rings` or :func:`strips` return.
    sensor : Sensor, optional
        Errors; None for a perfect sensor.
    seed : int
        Of the errors.

    Returns
    -------
    Scan
        Points lie on their rays whatever the errors.
    """
    sensor, rng = sensor or Sensor(), np.random.default_rng(seed)
    origins, directions = rays.origins.reshape(-1, 3), rays.directions.reshape(-1, 3)
    ranges, normals = np.full(len(directions), np.inf), np.zeros(directions.shape)
    for solid in solids:
        distance, normal = solid.meet(origins, directions)
        nearer = distance < ranges
        ranges[nearer], normals[nearer] = distance[nearer], normal[nearer]
    cosine = np.einsum("nd,nd->n", normals, directions)
    normals *= np.where(cosine > 0.0, -1.0, 1.0)[:, None]
    other = np.roll(ranges.reshape(rays.depth.shape), -1, axis=1).ravel()
    seen = np.isfinite(ranges)
    other = np.where(seen & np.isfinite(other), other, ranges)
    gap = np.subtract(other, ranges, where=seen, out=np.zeros(len(ranges)))
    stray = (np.abs(gap) > JUMP * np.minimum(ranges, other)) & (
        rng.random(len(ranges)) < sensor.mixed
    )
    ranges = ranges + np.where(stray, rng.random(len(ranges)) * gap, 0.0)
    lost = sensor.dropouts * np.where(np.abs(cosine) < GRAZING, 2.0, 1.0)
    kept = seen & (rng.random(len(ranges)) >= lost)
    measured = _measured(ranges[kept], rays.depth.ravel()[kept], sensor, rng)
    points = origins[kept] + measured[:, None] * directions[kept]
    return Scan(points, normals[kept], origins[kept], stray[kept])


def _measured(ranges: Array, depth: Array, sensor: Sensor, rng: np.random.Generator) -> Array:
    """Ranges with noise, then rounded."""
    noisy = ranges + sensor.noise * ranges**sensor.growth * rng.normal(size=len(ranges))
    if not sensor.step:
        return noisy
    if sensor.growth:  # the sensor counts disparities
        return np.asarray(
            1.0 / (np.round(1.0 / (noisy * depth * sensor.step)) * sensor.step * depth)
        )
    return np.asarray(np.round(noisy / sensor.step) * sensor.step)
