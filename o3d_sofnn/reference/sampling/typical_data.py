"""Fuzzy c-means in every cell: twin of ``native/sampling/typical_data.hpp``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def typical_data(
    points: Array,
    offsets: NDArray[np.int64],
    n_clusters: NDArray[np.int64],
    iterations: int,
    tolerance: float,
) -> Array:
    """Draw the typical data of every cell, eq. (1) to (6) with smoothing weight s = 2.

    Parameters
    ----------
    points : (n, 3) float64
        Points, cell by cell, along a curve within each.
    offsets : (c + 1,) int64
        Cell ``i`` holds ``points[offsets[i]:offsets[i + 1]]``, at least one point.
    n_clusters : (c,) int64
        Centres wanted in each cell.
    iterations : int
        Largest number of iterations.
    tolerance : float
        Stop when no membership moves by this much, the epsilon of step (d).

    Returns
    -------
    (sum of `n_clusters`, 3) float64
        Centres, cell by cell.
    """
    cells = zip(offsets[:-1], offsets[1:], n_clusters, strict=True)
    return np.concatenate(
        [
            _cluster(points[first:last], int(count), iterations, tolerance)
            for first, last, count in cells
        ]
    )


def first_centers(points: Array, n_clusters: int) -> Array:
    """Means of equal runs of points along the curve: the start, in place of random memberships.

    Parameters
    ----------
    points : (n, 3) float64
        Points of one cell.
    n_clusters : int
        Runs.

    Returns
    -------
    (n_clusters, 3) float64
    """
    n = len(points)
    centers = np.zeros((n_clusters, 3))
    for j in range(n_clusters):
        first = j * n // n_clusters
        last = max((j + 1) * n // n_clusters, first + 1)
        centers[j] = points[first:last].mean(axis=0)
    return centers


def _cluster(points: Array, n_clusters: int, iterations: int, tolerance: float) -> Array:
    centers = first_centers(points, n_clusters)
    if n_clusters == 1:
        return centers
    memberships = np.zeros((len(points), n_clusters))
    for _ in range(iterations):
        previous, memberships = memberships, _memberships(points, centers)
        weight = memberships**2
        owned = weight.sum(axis=0) > 0.0
        centers[owned] = (weight.T @ points)[owned] / weight.sum(axis=0)[owned, None]  # Eq. (2)
        if np.abs(memberships - previous).max() < tolerance:  # Eq. (6)
            break
    return centers


def _memberships(points: Array, centers: Array) -> Array:
    """Memberships of points in centres, eq. (3) to (5); points on a centre belong to it alone."""
    sq_dist = ((points[:, None] - centers) ** 2).sum(axis=2)
    hit = sq_dist == 0.0  # Eq. (3); its complement is eq. (4)
    closeness = np.where(hit.any(axis=1, keepdims=True), hit, 1.0 / np.where(hit, 1.0, sq_dist))
    return np.asarray(closeness / closeness.sum(axis=1, keepdims=True))  # Eq. (5)
