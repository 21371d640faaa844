"""The tiles of a cloud: octree cells of an absolute lattice, of about as many points each."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.tiles.lattice import BLOCK, Box, Lattice

Array = NDArray[np.float64]


Index = NDArray[np.int64]


DEPTH = 10
"""Subdivisions of the extent into the cells in which points are counted."""


CROWD = 8.0
"""Smallest mean number of points in the cells that show the spacing of a tile."""


RIM = 32.0
"""Width of the rim of points around a tile with which it is learned, divided by the spacing."""


class Cloud(ABC):
    """Points that are read part by part, as often as needed, in the same order."""

    @abstractmethod
    def chunks(self) -> Iterator[Array]:
        """Yield arrays, (n, 3) float64, of finite points."""

    def box(self) -> tuple[Array, Array]:
        """Return the lowest and highest coordinates."""
        parts = [(x.min(axis=0), x.max(axis=0)) for x in self.chunks() if len(x)]
        if not parts:
            raise ValueError("inputs: expected points, got none")
        low, high = zip(*parts, strict=True)
        return np.min(low, axis=0), np.max(high, axis=0)


@dataclass(frozen=True)
class Tile:
    """A cube of space, half open.

    Attributes
    ----------
    number : int
        Place in the order of the run.
    low, high : (3,) float64
        Corners, in counting cells from the origin of the run.
    count : int
        Number of points.
    rim : float
        Width of the rim with which it is learned, in counting cells.
    """

    number: int
    low: Array
    high: Array
    count: int
    rim: float

    def holds(self, x: Array) -> NDArray[np.bool_]:
        """Return whether points, (n, 3), are in the tile."""
        return np.asarray(((x >= self.low) & (x < self.high)).all(axis=1))

    def near(self, x: Array) -> NDArray[np.bool_]:
        """Return whether points, (n, 3), are in the tile or in its rim."""
        return np.asarray(((x >= self.low - self.rim) & (x < self.high + self.rim)).all(axis=1))

    def meshed(self, lattice: Lattice) -> Box:
        """Return the cubes whose surface is its own.

        They are whole blocks. Those below the first cells of the run, into which the surface may
        reach, belong to the first tiles.
        """
        box = lattice.box(self.low, self.high)
        return Box(np.where(self.low == 0.0, box.low - BLOCK, box.low), box.high)

    def touches(self, low: Array, high: Array) -> bool:
        """Return whether a closed box and the closed tile have a place in common."""
        return bool(((self.low <= high) & (self.high >= low)).all())


@dataclass(frozen=True)
class Counts:
    """Number of points in the cells of a lattice.

    Attributes
    ----------
    origin : (3,) float64
        A multiple of the cells' edge, in the user's coordinates.
    edge : float
        Edge of a cell: a power of two.
    cells : (c, 3) int64
        Cells with points.
    count : (c,) int64
        Number of points in each.
    """

    origin: Array
    edge: float
    cells: Index
    count: Index

    @classmethod
    def of(cls, chunks: Iterable[Array], low: Array, high: Array) -> Counts:
        """Count points that are read part by part, in a box."""
        edge, origin = lattice_of(low, high)
        keys, counts = np.zeros(0, np.int64), np.zeros(0, np.int64)
        for points in chunks:
            index = np.floor((points - origin) / edge).astype(np.int64)
            own = np.ravel_multi_index(tuple(index.T), (2 << DEPTH,) * 3)
            new, row = np.unique(own, return_counts=True)
            keys, back = np.unique(np.concatenate([keys, new]), return_inverse=True)
            both = np.concatenate([counts, row])
            counts = np.bincount(back.ravel(), both, len(keys)).astype(np.int64)
        cells = np.stack(np.unravel_index(keys, (2 << DEPTH,) * 3), axis=1).astype(np.int64)
        return cls(origin, edge, cells, counts)


def lattice_of(low: Array, high: Array) -> tuple[float, Array]:
    """Return the edge of the counting cells of a box, and the origin of the run."""
    extent = float((high - low).max()) or 1.0
    edge = float(2.0 ** (np.ceil(np.log2(extent)) - DEPTH))
    return edge, np.floor(low / edge) * edge


def plan(counts: Counts, points_per_tile: int) -> list[Tile]:
    """Divide space until no tile has more points than that.

    Parameters
    ----------
    counts : Counts
        Number of points in the counting cells; one cell is not divided.
    points_per_tile : int
        Largest number of points of a tile.

    Returns
    -------
    list of Tile
        Tiles that fill the box, in the order of their corners; some may have no points.
    """
    found: list[tuple[Index, int, Index]] = []
    waiting = [(np.zeros(3, np.int64), DEPTH + 1, np.arange(len(counts.cells)))]
    while waiting:
        corner, level, rows = waiting.pop()
        if int(counts.count[rows].sum()) <= points_per_tile or level == 0:
            found.append((corner, level, rows))
            continue
        half = 1 << level - 1
        octant = (counts.cells[rows] - corner >= half) @ np.array([1, 2, 4])
        for part in range(8):
            step = np.array([part & 1, part >> 1 & 1, part >> 2 & 1]) * half
            waiting.append((corner + step, level - 1, rows[octant == part]))
    found.sort(key=lambda each: (*each[0], each[1]))
    return [
        Tile(
            number,
            corner.astype(np.float64),
            (corner + (1 << level)).astype(np.float64),
            int(counts.count[rows].sum()),
            RIM * spacing_in(counts.cells[rows], counts.count[rows], 1 << level),
        )
        for number, (corner, level, rows) in enumerate(found)
    ]


def spacing_in(cells: Index, count: Index, edge: int) -> float:
    """Estimate the spacing of the points in a tile from how they fill cells, in cells.

    Parameters
    ----------
    cells : (c, 3) int64
        Counting cells with points.
    count : (c,) int64
        Number of points in each.
    edge : int
        Edge of the tile, in cells.
    """
    total, width = int(count.sum()), 1
    if not total:
        return 0.0
    while width < edge and total < CROWD * len(np.unique(cells // width, axis=0)):
        width *= 2
    return float(width * np.sqrt(len(np.unique(cells // width, axis=0)) / total))


class Finder:
    """Finds the tiles of points.

    Parameters
    ----------
    tiles : sequence of Tile
        Tiles that fill the box of the points.
    """

    def __init__(self, tiles: Sequence[Tile]) -> None:
        self._low = np.array([tile.low for tile in tiles]).astype(np.int64)
        self._edge = np.array([tile.high[0] - tile.low[0] for tile in tiles]).astype(np.int64)
        keys = _key(self._low, self._edge)
        self._order = np.argsort(keys)
        self._keys = keys[self._order]

    def tiles(self, x: Array) -> Index:
        """Return the number of the tile of each point, (n,)."""
        found, cells = np.full(len(x), -1), np.floor(x).astype(np.int64)
        for edge in np.unique(self._edge):
            keys = _key(cells // edge * edge, np.full(len(x), edge))
            place = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
            here = self._keys[place] == keys
            found[here] = self._order[place[here]]
        return found


def _key(low: Index, edge: Index) -> Index:
    """Return one number for each cube with a corner and an edge."""
    level = np.log2(edge).astype(np.int64)
    x, y, z = low.T
    return np.asarray(((level * (4 << DEPTH) + x) * (4 << DEPTH) + y) * (4 << DEPTH) + z)


def earlier(tiles: Sequence[Tile], lattice: Lattice) -> list[list[int]]:
    """Return for each tile the numbers of the earlier ones that its own cubes touch."""
    boxes = [tile.meshed(lattice) for tile in tiles]
    low, high = np.array([box.low for box in boxes]), np.array([box.high for box in boxes])
    some = np.all(low < high, axis=1)
    found = []
    for n in range(len(tiles)):
        apart = (low[:n] > high[n]) | (high[:n] < low[n])
        near = ~np.any(apart, axis=1) & some[:n] & some[n]
        found.append([int(each) for each in np.flatnonzero(near)])
    return found
