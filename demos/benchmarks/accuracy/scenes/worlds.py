"""The scenes: what stands in them, and where they are scanned from."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from scenes.sensors import Rays, Scan, Sensor, camera, cast, joined, rings, strips, tripod
from scenes.solids import Array, Ball, Box, Ground, Pipe, Solid

Station = Callable[[int, int], Rays]


@dataclass(frozen=True)
class Scene:
    """Solids, and the rays of each station as a function of columns and rows."""

    solids: Sequence[Solid]
    stations: Sequence[Station]


def from_tripod(*station: float) -> Station:
    """Return a scanner on a tripod."""
    return lambda columns, rows: tripod(station, columns, rows)


def from_camera(station: Sequence[float], target: Sequence[float]) -> Station:
    """Return a depth camera."""
    return lambda columns, rows: camera(station, target, columns, rows)


def _room() -> list[Solid]:
    legs = [(1.2 + x, 0.6 + y) for x in (-0.6, 0.6) for y in (-0.3, 0.3)]
    return [
        Box((0.0, 0.0, 1.3), (6.0, 4.5, 2.6)),
        Box((1.2, 0.6, 0.72), (1.6, 0.9, 0.04)),
        *(Box((x, y, 0.35), (0.06, 0.06, 0.7)) for x, y in legs),
        Box((-2.6, 0.5, 1.0), (0.6, 1.6, 2.0)),
        Box((-0.9, 1.8, 0.4), (1.9, 0.8, 0.8), 10.0),
        Ball((1.4, 0.7, 0.89), 0.15),
        Pipe((2.3, -1.7, 0.0), (2.3, -1.7, 1.6), 0.03),
        Ball((2.3, -1.7, 1.7), 0.2),
    ]


def _table() -> list[Solid]:
    return [
        Box((0.0, 0.0, -0.02), (1.2, 0.8, 0.04)),
        Ball((0.2, 0.1, 0.1), 0.1),
        Box((-0.25, 0.0, 0.09), (0.12, 0.2, 0.18), 30.0),
        Pipe((0.0, -0.2, 0.0), (0.0, -0.2, 0.15), 0.04),
        Ball((0.4, -0.2, 0.05), 0.05),
        Box((0.0, 1.2, 0.0), (4.0, 0.1, 3.0)),
    ]


def _street() -> list[Solid]:
    def height(x: Array, y: Array) -> Array:
        return np.asarray(0.01 * x + np.where(np.abs(y) > 5.0, 0.15, 0.0))

    blocks = [(x, y) for x in (-36.0, -21.0, -5.0, 12.0, 30.0) for y in (-12.0, 12.0)]
    cars = [(6.0, 3.8), (-9.0, -3.8), (17.0, -3.6), (-20.0, 3.7)]
    return [
        Ground(height, 60.0),
        *(Box((x, y, 5.0), (13.0, 8.0, 12.0 + 0.1 * x)) for x, y in blocks),
        *(part for x, y in cars for part in _car(x, y)),
        *(Pipe((x, 5.8, 0.0), (x, 5.8, 6.0), 0.1) for x in (-25.0, 0.0, 25.0)),
    ]


def _car(x: float, y: float) -> list[Solid]:
    wheels = [Ball((x + dx, y + dy, 0.3), 0.3) for dx in (-1.3, 1.3) for dy in (-0.8, 0.8)]
    return [Box((x, y, 0.7), (4.2, 1.7, 0.8)), Box((x - 0.2, y, 1.3), (2.2, 1.5, 0.5)), *wheels]


def _hills(x: Array, y: Array) -> Array:
    return np.asarray(3.0 * np.sin(0.05 * x) * np.cos(0.07 * y) + 0.5 * np.sin(0.3 * x + 0.2 * y))


def _terrain() -> list[Solid]:
    def on_ground(x: float, y: float) -> float:
        return float(_hills(np.float64(x), np.float64(y)))

    houses = [(-30.0, 10.0, 15.0), (20.0, -25.0, 40.0), (5.0, 30.0, 0.0)]
    trees = [(-10.0, -20.0), (35.0, 20.0), (-40.0, -35.0), (10.0, 8.0), (30.0, -5.0)]
    rng = np.random.default_rng(0)
    return [
        Ground(_hills, 60.0),
        *(Box((x, y, on_ground(x, y) + 2.5), (10.0, 8.0, 7.0), turn) for x, y, turn in houses),
        *(part for x, y in trees for part in _tree(x, y, on_ground(x, y), rng)),
    ]


def _tree(x: float, y: float, z: float, rng: np.random.Generator) -> list[Solid]:
    crown = rng.normal((x, y, z + 5.0), 1.0, (12, 3))
    leaves = [Ball((float(a), float(b), float(c)), 0.9) for a, b, c in crown]
    return [Pipe((x, y, z - 1.0), (x, y, z + 5.0), 0.2), *leaves]


def _pipes() -> list[Solid]:
    along = [(2.2, 2.5, 0.15), (2.5, 1.2, 0.25), (-2.0, 0.4, 0.1), (-2.4, 2.2, 0.3)]
    return [
        Box((0.0, 0.0, 1.5), (8.0, 6.0, 3.0)),
        *(Pipe((-3.9, y, z), (3.9, y, z), radius) for y, z, radius in along),
        *(Pipe((x, 2.2, 2.5), (x, 2.2, 3.0), 0.12) for x in (-2.0, 1.5)),
        Pipe((1.0, -1.2, 0.0), (1.0, -1.2, 1.4), 0.5),
        Ball((1.0, -1.2, 1.4), 0.5),
    ]


SCENES = {
    "room": Scene(_room(), [from_tripod(-0.4, -0.6, 1.4)]),
    "room, two stations": Scene(
        _room(), [from_tripod(-0.4, -0.6, 1.4), from_tripod(2.2, 1.5, 1.5)]
    ),
    "room, camera": Scene(_room(), [from_camera((-2.0, -1.9, 1.6), (1.2, 0.8, 0.7))]),
    "street": Scene(_street(), [from_tripod(0.0, 0.0, 1.9)]),
    "street, car": Scene(
        _street(), [lambda columns, rows: rings((0.0, 0.0, 1.9), columns * rows // 32)]
    ),
    "street, three stations": Scene(
        _street(), [from_tripod(x, 1.0, 1.9) for x in (-25.0, 0.0, 24.0)]
    ),
    "terrain": Scene(
        _terrain(), [lambda columns, rows: strips(90.0, 50.0, 2 * columns // 5, 5 * rows // 4)]
    ),
    "terrain, station": Scene(_terrain(), [from_tripod(0.0, -4.0, 3.5)]),
    "table": Scene(_table(), [from_camera((0.1, -1.1, 0.7), (0.0, 0.1, 0.05))]),
    "pipes": Scene(_pipes(), [from_tripod(-0.5, 0.2, 1.5)]),
}
"""By name; where there are several stations every point still knows its own."""


def make(name: str, count: int = 20_000, sensor: Sensor | None = None, seed: int = 0) -> Scan:
    """Scan one of ``SCENES``.

    Parameters
    ----------
    name : str
        Of the scene.
    count : int
        Rays, about; those that meet nothing are lost.
    sensor : Sensor, optional
        Errors; None for a perfect sensor.
    seed : int
        Of the errors and of the order of the points.

    Returns
    -------
    Scan
        Shuffled.
    """
    scene = SCENES[name]
    rows = max(2, round((0.5 * count / len(scene.stations)) ** 0.5))
    scan = joined(
        [
            cast(scene.solids, station(2 * rows, rows), sensor, seed + index)
            for index, station in enumerate(scene.stations)
        ]
    )
    return scan.taken(np.random.default_rng(seed).permutation(len(scan.points)))
