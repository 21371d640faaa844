"""Neighbours by looking at every point: twin of ``native/geometry/kdtree.hpp``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def query(
    points: NDArray[np.float64], x: NDArray[np.float64], k: int, max_distance: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Find the nearest points of every place.

    The neighbourhoods that Algorithm 1 (steps 2 to 5) fits planes and quadrics to.

    Parameters
    ----------
    points : (n, 3) float64
        Points searched; repeated ones are neighbours of each other at distance zero.
    x : (m, 3) float64
        Places.
    k : int
        Neighbours wanted for each place.
    max_distance : float
        Points farther away do not count, in the unit of the points.

    Returns
    -------
    distance : (m, k) float64
        Nearest first; infinite where there are fewer than `k` neighbours.
    index : (m, k) int64
        Rows of `points`; of equally near ones the smaller index comes first. ``n`` where there are
        fewer than `k` neighbours.
    """
    distance = np.full((len(x), k), np.inf)
    index = np.full((len(x), k), len(points), np.int64)
    for row, place in enumerate(x):
        dx, dy, dz = (points - place).T
        sq_dist = dx * dx + dy * dy + dz * dz
        order = np.lexsort((np.arange(len(points)), sq_dist))
        order = order[sq_dist[order] <= max_distance * max_distance][:k]
        distance[row, : len(order)] = np.sqrt(sq_dist[order])
        index[row, : len(order)] = order
    return distance, index


def crowded(
    points: NDArray[np.float64], x: NDArray[np.float64], k: int, distance: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """Tell whether enough points are near: what is not alone is no outlier (Algorithm 1, step 5).

    Parameters
    ----------
    points, x, k
        As in :func:`query`.
    distance : (m,) float64
        How far counts as near, in the unit of the points.

    Returns
    -------
    (m,) uint8
        1 where at least `k` points lie within the distance, else 0.
    """
    near = ((points - x[:, None]) ** 2).sum(axis=2) <= (distance**2)[:, None]
    return np.asarray(near.sum(axis=1) >= k, np.uint8)
