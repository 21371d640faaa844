"""Stage 9: sparse isosurface. Cubes with data and those the surface leads to until it closes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from ._kernels import KdTree
from .grid import AdaptiveGrid
from .marching_cubes import CORNERS, marching_cubes

Evaluate = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]

SAMPLES = 16
"""Fewest samples on a closed piece of surface that is kept."""


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
    # Far away only the sign counts. In proportion to the leaves it lets the wall cut straight.
    values = np.where(support > 0.0, values, values * grid.edges(leaves))
    wall = np.maximum(grid.low - x, x - grid.high).max(axis=1)
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


def keep_supported(
    vertices: NDArray[np.float64],
    triangles: NDArray[np.int32],
    confidence: NDArray[np.float64],
    samples: NDArray[np.float64],
    trim: float | None,
    n_threads: int,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64]]:
    """Drop closed pieces that hardly any sample lies on and, with `trim`, single triangles.

    Parameters
    ----------
    vertices, triangles
        A closed mesh.
    confidence : (m,) float64
        Support at the vertices.
    samples : (n, 3) float64
        Points moved onto the surface.
    trim : float or None
        Least mean confidence of a triangle that stays.
    n_threads : int
        Threads.

    Returns
    -------
    vertices, triangles, confidence
        What stays.
    """
    if not len(triangles):
        return vertices, triangles, confidence
    edges = np.concatenate([triangles[:, :2], triangles[:, 1:]])
    graph = scipy.sparse.coo_matrix(
        (np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(len(vertices),) * 2
    )
    label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    nearest = KdTree(vertices, n_threads).query(samples, 1, np.inf, n_threads)[1][:, 0]
    count = np.bincount(label[nearest], minlength=int(label.max()) + 1)
    keep = (count >= min(SAMPLES, int(count.max())))[label[triangles[:, 0]]]
    if trim is not None:
        keep &= confidence[triangles].mean(axis=1) >= trim
    triangles = triangles[keep]
    used = np.unique(triangles)
    number = np.zeros(len(vertices), np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    return vertices[used], number[triangles], confidence[used]


def mesh_normals(
    vertices: NDArray[np.float64], triangles: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Average the normals of the triangles by their area; unit vertex normals, (m, 3)."""
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    facing = np.cross(b - a, c - a)
    total = np.stack(
        [np.bincount(triangles.ravel(), np.repeat(f, 3), len(vertices)) for f in facing.T], axis=1
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 0, total / np.maximum(length, 1e-300), [0.0, 0.0, 1.0])


def attribute_weights(
    vertices: NDArray[np.float64], points: NDArray[np.float64], size: float, n_threads: int
) -> scipy.sparse.csr_matrix:
    """Weights that carry attributes from points to vertices.

    Parameters
    ----------
    vertices : (m, 3) float64
        Where the attributes are wanted.
    points : (n, 3) float64
        Where they are known.
    size : float
        Distance over which a point counts.
    n_threads : int
        Threads.

    Returns
    -------
    scipy.sparse.csr_matrix, (m, n)
        Gaussian weights of the four nearest points; rows sum to one.
    """
    k = min(4, len(points))
    distance, index = KdTree(points, n_threads).query(vertices, k, np.inf, n_threads)
    weight = np.exp(-0.5 * (distance**2 - distance[:, :1] ** 2) / size**2)
    weight /= weight.sum(axis=1, keepdims=True)
    start = np.arange(0, len(vertices) * k + 1, k)
    return scipy.sparse.csr_matrix(
        (weight.ravel(), index.ravel(), start), shape=(len(vertices), len(points))
    )
