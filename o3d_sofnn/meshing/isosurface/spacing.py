"""Distance between neighbouring samples, along and across scan lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree

AMONG = 24
"""Number of neighbours that determine the spacing at a point."""


ALONG = 4
"""Number of these that determine the direction of a scan line."""


LINE = 0.866
"""Cosine to the direction of a scan line above which a neighbour is on that line."""


ACROSS = 0.8
"""Spacing divided by the distance across scan lines; for randomly drawn points, it exceeds the mean
at one point in 25."""


PLACES = 50_000
"""Largest number of points at which the spacing is measured."""


UNEVEN = 1.6
"""Spacing of the neighbours of a point, divided by the spacing of its region, above which the
density is uneven there: none of a hundred million uniformly drawn points; 1.4 at a border."""


def spacing_around(
    points: NDArray[np.float64], tree: KdTree
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Measure the distance between neighbours around every point: the mean and the largest.

    Parameters
    ----------
    points : (n, 3) float64
        Points in Morton order.
    tree : KdTree
        Tree of the points.

    Returns
    -------
    mean : (n,) float64
        The edge of the square that one point covers.
    widest : (n,) float64
        Distance from the scan line of each point to the next line, if that is more than the spacing
        of the nearest `AMONG` points.
    """
    few = 1 + len(points) // PLACES
    places = np.ascontiguousarray(points[few // 2 :: few])
    distance, index = tree.query(places, min(AMONG, len(points)), np.inf)
    k = distance.shape[1]
    step = points[index[:, 1:]] - places[:, None]
    next_ones = step[:, :ALONG] / np.maximum(distance[:, 1 : ALONG + 1, None], 1e-300)
    line = np.linalg.eigh(np.einsum("mki,mkj->mij", next_ones, next_ones))[1][:, :, 2]
    along = np.abs(np.einsum("mki,mi->mk", step, line))
    beside = np.where(along < LINE * distance[:, 1:], distance[:, 1:], distance[:, -1:])
    area = np.pi * distance[:, -1] ** 2 / max(k - 0.5, 1.0)
    even, across = np.sqrt(area), ACROSS * beside.min(axis=1)
    row = np.minimum(np.arange(len(points)) // few, len(places) - 1)
    return even[row], np.maximum(even, across)[row]


def local_spacing(
    spacing: NDArray[np.float64],
    on_solid: NDArray[np.bool_],
    points: NDArray[np.float64],
    tree: KdTree,
) -> NDArray[np.float64]:
    """Correct the spacing where the regional value is too small: scenes, and uneven density.

    Parameters
    ----------
    spacing : (n,) float64
        Edge of the square that one point covers in the region of each point.
    on_solid : (n,) bool
        Points for which the regional value is valid unless the density is uneven.
    points, tree
        As in :func:`spacing_around`.

    Returns
    -------
    (n,) float64
    """
    mean, widest = spacing_around(points, tree)
    holds = np.where(on_solid, mean, widest) <= UNEVEN * spacing
    return np.where(holds, spacing, widest)
