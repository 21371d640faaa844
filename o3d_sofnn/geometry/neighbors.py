"""What nearest neighbours say about the sampling of a surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree

LEAST = 2.0**-50
"""Least area of a sample in the unit cube, the square of its resolution: that of one alone, too."""


def neighborhood_areas(
    places: NDArray[np.float64], tree: KdTree, n_threads: int
) -> NDArray[np.float64]:
    """Area of surface that one sample covers, at some of them.

    Parameters
    ----------
    places : (m, 3) float64
        Samples.
    tree : KdTree
        Over all samples.
    n_threads : int
        Number of threads.

    Returns
    -------
    (m,) float64
        ``pi r_k^2 / k`` with the k nearest, above zero.
    """
    k = min(9, tree.size)
    distance, _ = tree.query(places, k, np.inf, n_threads)
    return np.asarray(np.maximum(np.pi * distance[:, -1] ** 2 / max(k - 0.5, 1.0), LEAST))
