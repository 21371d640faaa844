"""Adaptive grid of the extraction: a balanced octree, fine at the data, and the cubes of its dual.

The function is sampled in the middle of the leaves. A dual cube belongs to a corner of the octree
and joins the middles of the eight leaves around it (Schaefer and Warren, "Dual marching cubes",
2004). Where leaves have one size these are the cubes of a regular grid; where the size changes
corners of a cube coincide, and the cubes still meet face to face: the surface has no cracks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import DualWalk
from o3d_sofnn.geometry.vectors import bounds

Keys = NDArray[np.int64]


BITS = 21
"""Bits of a coordinate in a key."""


FIELD = 2**BITS - 1


MARGIN, LEAST = 8, 2
"""Finest cells between the data and the wall of the domain, outside of which there is no inside:
fewer where cells are so coarse that they would be more than :data:`BEYOND`, but at least two."""


BEYOND = 0.4
"""Most of the longest side of the data that the wall is away from it. Steps that move vertices go
as far again at most, so that no mesh reaches more than a longest side beyond its data."""


COARSEST = 16
"""Largest leaves along the longest side of the data, at least."""


class AdaptiveGrid:
    """Leaves of a balanced octree over all space.

    A leaf is named by its middle, a corner of the octree by its place, in half cells.

    Parameters
    ----------
    points : (n, 3) float64
        What the grid has to hold.
    size : float
        Edge of a finest cell, in the unit of the points.
    levels : (n,) int64
        Leaves around a point have edges of at most ``size * 2**level``.

    Raises
    ------
    ValueError
        There were more than 500,000 cells along an axis.
    """

    def __init__(self, points: NDArray[np.float64], size: float, levels: NDArray[np.int64]) -> None:
        low, high = bounds(points)
        extent = float((high - low).max())
        cells = extent / size
        if not cells < 2 ** (BITS - 2) - 2**10:
            raise ValueError(
                f"voxel_size: expected at most 5e5 cubes along one side, got {cells:.3g}"
            )
        self.size = size
        self.top = max(int(np.log2(max(cells / COARSEST, 1.0))), int(levels.max()))
        margin = min(MARGIN * size, max(BEYOND * extent, LEAST * size))
        self.low = low - margin
        self.high = high + margin
        self.origin = self.low - size * (4 << self.top)
        self._points, self._levels = points, levels

    def walk(self, n_threads: int = 1) -> DualWalk:
        """Walk over the dual cubes, beginning with those that hold the points."""
        return DualWalk(self._points, self.origin, self.size, self._levels, self.top, n_threads)

    def edges(self, leaves: Keys) -> NDArray[np.int64]:
        """Edge of leaves in finest cells: the middle is an odd multiple of half of it."""
        return np.asarray(leaves & -leaves & FIELD)

    def positions(self, leaves: Keys) -> NDArray[np.float64]:
        """Middles of leaves, (m, 3)."""
        return np.asarray(self.origin + 0.5 * self.size * unpack(leaves))


def unpack(keys: Keys) -> NDArray[np.int64]:
    """Integer coordinates of keys, (...) to (..., 3)."""
    return np.stack([keys & FIELD, keys >> BITS & FIELD, keys >> 2 * BITS], axis=-1)
