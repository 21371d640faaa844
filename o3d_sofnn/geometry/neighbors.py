"""Areas of samples from their nearest neighbours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree

LEAST = 2.0**-50
"""Smallest area of a sample in the unit cube: its squared resolution; also used for one sample."""


def neighborhood_areas(places: NDArray[np.float64], tree: KdTree) -> NDArray[np.float64]:
    """Return the area of surface that each of some samples covers.

    Parameters
    ----------
    places : (m, 3) float64
        Samples.
    tree : KdTree
        Tree of all samples.

    Returns
    -------
    (m,) float64
        ``pi r_k^2 / k`` from the distance to the k-th nearest sample; positive.
    """
    k = min(9, tree.size)
    distance, _ = tree.query(places, k, np.inf)
    return np.asarray(np.maximum(np.pi * distance[:, -1] ** 2 / max(k - 0.5, 1.0), LEAST))
