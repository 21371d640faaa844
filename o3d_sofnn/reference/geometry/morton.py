"""Morton order by interleaving bits: twin of ``native/geometry/morton.hpp``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LEVELS = 21
"""Bits an axis."""


def sort_morton(points: NDArray[np.float64]) -> tuple[NDArray[np.uint64], NDArray[np.int64]]:
    """Sort points along the Morton curve: interleave the bits of the quantised coordinates.

    The octree of Algorithm 1, steps 2 and 7: cells are ranges of these keys.

    Parameters
    ----------
    points : (n, 3) float64
        Points in any unit.

    Returns
    -------
    keys : (n,) uint64
        Ascending, 21 bits an axis.
    order : (n,) int64
        Row that each comes from; of equal keys the smaller row first.
    """
    low = points.min(axis=0)
    extent = float((points.max(axis=0) - low).max())
    scale = (2**LEVELS - 1) / extent if extent > 0 else 0.0
    keys = np.zeros(len(points), np.uint64)
    for axis in range(3):
        bits = ((points[:, axis] - low[axis]) * scale).astype(np.uint64)
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            bits = (bits | (bits << np.uint64(shift))) & np.uint64(mask)
        keys |= bits << np.uint64(axis)
    order = np.argsort(keys, kind="stable")
    return keys[order], order
