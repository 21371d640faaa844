"""Stage 1: adaptive cells. Points sorted along the Morton curve, leaves as index ranges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import sort_morton
from o3d_sofnn.geometry.vectors import longest_side

LEVELS = 21
"""Subdivisions that fit a 64-bit Morton key, three bits each."""


@dataclass(frozen=True)
class Octree:
    """Points in Morton order, and the leaves of their octree.

    Attributes
    ----------
    order : (n,) int64
        Index of the input point at each position along the Morton curve.
    points : (n, 3) float64
        The points in that order.
    offsets : (c + 1,) int64
        Leaf ``i`` holds ``points[offsets[i]:offsets[i + 1]]``.
    size : (c,) float64
        Edge length of each leaf, in the unit of the points.
    """

    order: NDArray[np.int64]
    points: NDArray[np.float64]
    offsets: NDArray[np.int64]
    size: NDArray[np.float64]


def sort_unique(
    points: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Morton order of the distinct points.

    Parameters
    ----------
    points : (n, 3) float64
        Points; duplicates are allowed.

    Returns
    -------
    order : (m,) int64
        Index of the first occurrence of each distinct point, along the Morton curve.
    inverse : (n,) int64
        Position in ``order`` of each input point.
    """
    keys, order = sort_morton(points, 1)
    shared = np.flatnonzero(keys[1:] == keys[:-1]) + 1
    new = np.ones(len(points), bool)
    if len(shared):  # coordinates decide, so that equal points become neighbours
        x, y, z = points[order].T
        order = order[np.lexsort((z, y, x, keys))]
        new[shared] = (points[order[shared]] != points[order[shared - 1]]).any(axis=1)
    inverse = np.empty(len(points), np.int64)
    inverse[order] = np.cumsum(new) - 1
    return order[new], inverse


def build_octree(points: NDArray[np.float64], capacity: int) -> Octree:
    """Divide space until no leaf holds more than `capacity` points (Algorithm 1, steps 2 and 7).

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points.
    capacity : int
        Largest number of points in a leaf. Leaves of the finest level may hold more.

    Returns
    -------
    Octree
        Only leaves that contain points.
    """
    keys, order = sort_morton(points, 1)
    extent = longest_side(points)
    start, stop = np.array([0]), np.array([len(points)])
    done: list[tuple[NDArray[np.int64], float]] = []
    for level in range(LEVELS + 1):
        full = (stop - start > capacity) & (level < LEVELS)
        done.append((start[~full], extent / 2**level))
        start, stop = start[full], stop[full]
        if not len(start):
            break
        shift = np.uint64(3 * (LEVELS - level - 1))
        parent = keys[start] >> (shift + np.uint64(3))
        children = (parent[:, None] << np.uint64(3)) + np.arange(1, 8, dtype=np.uint64)
        inner = np.searchsorted(keys, children << shift)
        bounds = np.concatenate([start[:, None], inner, stop[:, None]], axis=1)
        start, stop = bounds[:, :-1].ravel(), bounds[:, 1:].ravel()
        occupied = stop > start
        start, stop = start[occupied], stop[occupied]
    first = np.concatenate([leaf for leaf, _ in done])
    size = np.concatenate([np.full(len(leaf), edge) for leaf, edge in done])
    place = np.argsort(first, kind="stable")
    offsets = np.append(first[place], len(points)).astype(np.int64)
    return Octree(order, np.ascontiguousarray(points[order]), offsets, size[place])
