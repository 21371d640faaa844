"""Adaptive grid of the extraction: a balanced octree, fine at the data, and the cubes of its dual.

The function is sampled in the middle of the leaves. A dual cube belongs to a corner of the octree
and joins the middles of the eight leaves around it (Schaefer and Warren, "Dual marching cubes",
2004). Where leaves have one size these are the cubes of a regular grid; where the size changes
corners of a cube coincide, and the cubes still meet face to face: the surface has no cracks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .marching_cubes import CORNERS

Keys = NDArray[np.int64]

BITS = 21
"""Bits of a coordinate in a key."""
FIELD = 2**BITS - 1
MARGIN = 8
"""Finest cells between the data and the wall of the domain, outside of which there is no inside."""
COARSEST = 16
"""Largest leaves along the longest side of the data, at least."""
AROUND = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], [-1, 0, 1], indexing="ij"), -1).reshape(-1, 3)


def _ring(axis: int, side: int) -> list[int]:
    u, v = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
    return [side << axis | corner for corner in (0, u, u | v, v)]


RINGS = [[_ring(axis, side) for side in (0, 1)] for axis in range(3)]
"""Corners of the faces of a cube in a ring, by axis and side."""


def pack(index: NDArray[np.int64]) -> Keys:
    """Keys of integer coordinates, (..., 3) to (...)."""
    return np.asarray(index[..., 0] + (index[..., 1] << BITS) + (index[..., 2] << 2 * BITS))


def unpack(keys: Keys) -> NDArray[np.int64]:
    """Integer coordinates of keys, (...) to (..., 3)."""
    return np.stack([keys & FIELD, keys >> BITS & FIELD, keys >> 2 * BITS], axis=-1)


def halve(keys: Keys, times: int) -> Keys:
    """Keys of the coordinates divided by ``2**times``."""
    field = FIELD >> times
    return np.asarray(keys >> times & (field | field << BITS | field << 2 * BITS))


def distinct(keys: Keys) -> Keys:
    """Return the different keys in order; several times as fast as ``numpy.unique`` on millions."""
    keys = np.sort(keys, axis=None)
    first = np.ones(len(keys), bool)
    first[1:] = keys[1:] != keys[:-1]
    return np.asarray(keys[first])


def contains(sorted_keys: Keys, keys: Keys) -> NDArray[np.bool_]:
    """Whether `keys` are among `sorted_keys`."""
    if not len(sorted_keys):
        return np.zeros(keys.shape, bool)
    place = np.minimum(np.searchsorted(sorted_keys, keys), len(sorted_keys) - 1)
    return np.asarray(sorted_keys[place] == keys)


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
        cells = np.ptp(points, axis=0).max() / size
        if not cells < 2 ** (BITS - 2) - 2**10:
            raise ValueError(f"voxel_size is too small: {cells:.3g} cubes along one axis")
        self.size = size
        self.top = max(int(np.log2(max(cells / COARSEST, 1.0))), int(levels.max()))
        self.low = points.min(axis=0) - MARGIN * size
        self.high = points.max(axis=0) + MARGIN * size
        self.origin = self.low - size * (4 << self.top)
        self._refined = [np.zeros(0, np.int64)]
        index = ((points - self.origin) / size).astype(np.int64)
        for level in range(self.top):
            own = halve(distinct(pack(index[levels == level] >> level)), 1)
            near = (distinct(own)[:, None] + pack(AROUND)).ravel()
            # Leaves that touch differ by one level at most: all around a cell there are cells.
            touched = (self._refined[-1][:, None] + pack(AROUND[(AROUND != 0).all(axis=1)])).ravel()
            self._refined.append(distinct(np.concatenate([near, halve(distinct(touched), 1)])))

    def cubes_at(self, x: NDArray[np.float64], levels: NDArray[np.int64]) -> Keys:
        """Dual cubes that hold places whose leaves have the given levels; sorted."""
        edge = np.left_shift(1, levels)[:, None]
        index = np.rint((x - self.origin) / self.size / edge).astype(np.int64) * edge
        return distinct(pack(2 * index))

    def corners(self, cubes: Keys) -> tuple[Keys, NDArray[np.int64]]:
        """Leaves at the corners of sorted dual cubes.

        Returns
        -------
        leaves : (k,) int64
            Sorted.
        index : (m, 8) int64
            Which of them are the corners of each cube, in the order of ``CORNERS``.
        """
        cells = cubes + pack(2 * CORNERS - 1)[:, None]
        around = distinct(cells)
        found = self._leaves(around)
        leaves = distinct(found)
        # A row of `cells` is sorted, which makes this search a fast one.
        back = np.searchsorted(leaves, found)
        return leaves, np.stack([back[np.searchsorted(around, row)] for row in cells], axis=1)

    def _leaves(self, middles: Keys) -> Keys:
        """Leaves that hold the finest cells with the given middles."""
        cell = halve(middles, 1)
        leaves = middles.copy()
        left = np.arange(len(cell))
        for level in range(1, self.top + 1):
            left = left[~contains(self._refined[level], halve(cell[left], level))]
            coarse = halve(cell[left], level)
            leaves[left] = pack((2 * unpack(coarse) + 1) << level)
        return leaves

    def edges(self, leaves: Keys) -> NDArray[np.int64]:
        """Edge of leaves in finest cells: the middle is an odd multiple of half of it."""
        return np.asarray(leaves & -leaves & FIELD)

    def positions(self, leaves: Keys) -> NDArray[np.float64]:
        """Middles of leaves, (m, 3)."""
        return np.asarray(self.origin + 0.5 * self.size * unpack(leaves))

    def across(
        self,
        cubes: Keys,
        leaves: Keys,
        index: NDArray[np.int64],
        crossed: NDArray[np.bool_],
    ) -> Keys:
        """Dual cubes on the other side of faces.

        Parameters
        ----------
        cubes : (m,) int64
        leaves, index
            Their corners.
        crossed : (m, 3, 2) bool
            Faces of interest, by axis and side.

        Returns
        -------
        (k,) int64
            Sorted. A face with corners that coincide in pairs has no other side.
        """
        found = []
        for axis in range(3):
            for side in (0, 1):
                which = np.flatnonzero(crossed[:, axis, side])
                ring = leaves[index[which][:, RINGS[axis][side]]]
                proper = (ring != np.roll(ring, 1, axis=1)).sum(axis=1) >= 3
                which, ring = which[proper], ring[proper]
                # The dual edge ends where the smallest leaf beside it does.
                middle = ring >> axis * BITS & FIELD
                half = self.edges(ring)
                end = (middle + half).min(axis=1) if side else (middle - half).max(axis=1)
                step = end - (cubes[which] >> axis * BITS & FIELD)
                found.append(cubes[which] + (step << axis * BITS))
        return distinct(np.concatenate(found))
