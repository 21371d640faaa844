"""Adaptive grid of the extraction: a balanced octree, fine at the data, and the cubes of its dual.

The function is sampled at the middles of the leaves. A dual cube belongs to a corner of the octree
and connects the middles of the eight leaves around it (Schaefer and Warren, "Dual marching cubes",
2004). Where leaves have the same size, these are the cubes of a regular grid; where the size
changes, corners of a cube coincide, but the cubes still meet face to face: there are no cracks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import DualWalk
from o3d_sofnn.geometry.vectors import bounds
from o3d_sofnn.threads import thread_count

Keys = NDArray[np.int64]


BITS = 21
"""Bits of a coordinate in a key."""


FIELD = 2**BITS - 1


MARGIN, LEAST = 8, 2
"""Number of finest cells between the data and the wall of the domain, beyond which everything is
outside: fewer, but at least two, if cells are so coarse that this would exceed :data:`BEYOND`."""


BEYOND = 0.4
"""Largest distance of the wall from the data, divided by their longest side. Later steps move
vertices at most as far again, so a mesh reaches at most one longest side beyond its data."""


COARSEST = 16
"""Smallest number of largest leaves along the longest side of the data."""


class AdaptiveGrid:
    """Leaves of a balanced octree that covers all space.

    A leaf is identified by its middle, a corner of the octree by its position, in half cells.

    Parameters
    ----------
    points : (n, 3) float64
        Points that the grid must contain.
    size : float
        Edge of a finest cell, in the unit of the points.
    levels : (n,) int64
        Leaves around a point have edges of at most ``size * 2**level``.

    Raises
    ------
    ValueError
        There would be more than 500,000 cells along an axis.
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

    def walk(self) -> DualWalk:
        """Start a walk through the dual cubes, beginning with those that contain the points."""
        return DualWalk(
            self._points, self.origin, self.size, self._levels, self.top, thread_count()
        )

    def edges(self, leaves: Keys) -> NDArray[np.int64]:
        """Return the edge of leaves in finest cells: middles are odd multiples of half the edge."""
        return np.asarray(leaves & -leaves & FIELD)

    def positions(self, leaves: Keys) -> NDArray[np.float64]:
        """Return the middles of leaves, (m, 3)."""
        return np.asarray(self.origin + 0.5 * self.size * unpack(leaves))


def unpack(keys: Keys) -> NDArray[np.int64]:
    """Return the integer coordinates, (..., 3), of keys, (...)."""
    return np.stack([keys & FIELD, keys >> BITS & FIELD, keys >> 2 * BITS], axis=-1)
