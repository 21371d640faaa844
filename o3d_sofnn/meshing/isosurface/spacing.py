"""Distance of neighbouring samples, along scan lines and across them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree

AMONG = 24
"""Points around a place that tell how far apart they are."""


ALONG = 4
"""Those of them that tell where a scan line goes."""


LINE = 0.866
"""Cosine to the direction of a scan line from which on a neighbour is on that line."""


ACROSS = 0.8
"""Spacing over the distance across scan lines; among points drawn at random one in 25 says more
than the mean."""


PLACES = 50_000
"""Points of many that are asked."""


UNEVEN = 1.6
"""Ratio of the spacing that the points around one show to that of its region from which on the
density is uneven there: none in a hundred million points drawn evenly, 1.4 at a border."""


def spacing_around(
    points: NDArray[np.float64], tree: KdTree, n_threads: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance of neighbours around every point, in the mean and where it is largest.

    Parameters
    ----------
    points : (n, 3) float64
        In Morton order.
    tree : KdTree
        Over them.
    n_threads : int
        Number of threads.

    Returns
    -------
    mean : (n,) float64
        The edge of the square that one point covers.
    widest : (n,) float64
        What separates the scan line that each point is on from the next one, if that is more; at
        least what `AMONG` points show.
    """
    few = 1 + len(points) // PLACES
    places = np.ascontiguousarray(points[few // 2 :: few])
    distance, index = tree.query(places, min(AMONG, len(points)), np.inf, n_threads)
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
    n_threads: int,
) -> NDArray[np.float64]:
    """Spacing of samples where that of a region is too small: scenes, and uneven density.

    Parameters
    ----------
    spacing : (n,) float64
        Edge of the square that one point covers in the region of each.
    on_solid : (n,) bool
        Points for which that holds unless the density is uneven.
    points, tree, n_threads
        As in :func:`spacing_around`.

    Returns
    -------
    (n,) float64
    """
    mean, widest = spacing_around(points, tree, n_threads)
    holds = np.where(on_solid, mean, widest) <= UNEVEN * spacing
    return np.where(holds, spacing, widest)
