"""Stage 9: sparse isosurface. Cubes with data and those the surface leads to until it closes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .grid import AdaptiveGrid
from .marching_cubes import CORNERS, marching_cubes

Evaluate = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]


WALL = 16.0
"""Factor of the far field beside the wall of the domain."""


def extract(
    evaluate: Evaluate,
    seeds: NDArray[np.float64],
    size: float,
    levels: NDArray[np.int64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Triangulate the zero set of a function through the cubes around some seeds.

    Starting from the cubes that hold seeds, every cube across a face with a change of sign is
    added, until there is none left: the surface is closed, and pieces without data are never met.
    The cubes grow with the distance from the seeds.

    Parameters
    ----------
    evaluate : callable
        (m, 3) places to (m,) values, negative inside, and (m,) support.
    seeds : (n, 3) float64
        Points near the surface.
    size : float
        Edge of a finest cube.
    levels : (n,) int64, optional
        Cubes around a seed have an edge of ``size * 2**level``. None for 0.

    Returns
    -------
    vertices : (v, 3) float64
    triangles : (t, 3) int32
        A closed manifold, outward.
    """
    if levels is None:
        levels = np.zeros(len(seeds), np.int64)
    grid = AdaptiveGrid(seeds, size, levels)
    cubes, nodes = SortedMap(), SortedMap()
    rounds = []
    fresh = grid.cubes_at(seeds, levels)
    while len(fresh):
        leaves, index = grid.corners(fresh)
        wanted = nodes.missing(leaves)
        if len(wanted):
            nodes.add(wanted, _walled(evaluate, grid, wanted))
        cubes.add(fresh, np.zeros(len(fresh)))
        inside = (nodes.get(leaves) < 0)[index]
        rounds.append((leaves, index[inside.any(axis=1) & ~inside.all(axis=1)]))
        fresh = cubes.missing(grid.across(fresh, leaves, index, _crossed(inside)))
    keys, values = nodes.items()
    corners = [np.searchsorted(keys, leaves)[index] for leaves, index in rounds]
    return marching_cubes(values, grid.positions(keys), np.concatenate(corners))


def _crossed(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether faces of cubes have corners inside and outside, (m, 3, 2) by axis and side."""
    result = np.zeros((len(inside), 3, 2), bool)
    for axis in range(3):
        for side in (0, 1):
            face = inside[:, CORNERS[:, axis] == side]
            result[:, axis, side] = face.any(axis=1) & ~face.all(axis=1)
    return result


def _walled(
    evaluate: Evaluate, grid: AdaptiveGrid, leaves: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Evaluate in the middle of leaves; outside of the box of the domain all is outside."""
    x = grid.positions(leaves)
    values, support = evaluate(x)
    # Far away only the sign counts. Large values let the wall cut straight.
    edge = grid.edges(leaves)
    wall = np.maximum(grid.low - x, x - grid.high).max(axis=1)
    at_wall = wall > -2.0 * grid.size * edge
    values = np.where(support > 0.0, values, values * edge * np.where(at_wall, WALL, 1.0))
    return np.asarray(np.maximum(values, wall))


class SortedMap:
    """Numbers by integer key: a large sorted array and a small one, merged now and then."""

    def __init__(self) -> None:
        self._parts = [(np.empty(0, np.int64), np.empty(0))] * 2

    def missing(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """Those of `keys` that are not in the map."""
        for known, _ in self._parts:
            if len(known):
                place = np.minimum(np.searchsorted(known, keys), len(known) - 1)
                keys = keys[known[place] != keys]
        return keys

    def add(self, keys: NDArray[np.int64], values: NDArray[np.float64]) -> None:
        """Put in sorted keys that are not there yet."""
        old, new = self._parts
        new = _merged(new, (keys, values))
        if len(new[0]) > len(old[0]) // 8:
            old, new = _merged(old, new), (new[0][:0], new[1][:0])
        self._parts = [old, new]

    def get(self, keys: NDArray[np.int64]) -> NDArray[np.float64]:
        """Values of keys that are in the map."""
        result = np.zeros(keys.shape)
        for known, values in self._parts:
            if len(known):
                place = np.minimum(np.searchsorted(known, keys), len(known) - 1)
                result = np.where(known[place] == keys, values[place], result)
        return result

    def items(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """All keys, sorted, and their values."""
        return _merged(*self._parts)


_Part = tuple[NDArray[np.int64], NDArray[np.float64]]


def _merged(a: _Part, b: _Part) -> _Part:
    place = np.searchsorted(a[0], b[0])
    return np.insert(a[0], place, b[0]), np.insert(a[1], place, b[1])
