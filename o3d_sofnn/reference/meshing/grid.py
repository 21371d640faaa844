"""Octree and walk over the cubes of its dual: twin of ``native/meshing/dual_walk.hpp``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.meshing.isosurface.grid import BITS, FIELD, unpack
from o3d_sofnn.meshing.isosurface.marching_cubes import CORNERS

Keys = NDArray[np.int64]

AROUND = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], [-1, 0, 1], indexing="ij"), -1).reshape(-1, 3)


def _ring(axis: int, side: int) -> list[int]:
    u, v = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
    return [side << axis | corner for corner in (0, u, u | v, v)]


RINGS = [[_ring(axis, side) for side in (0, 1)] for axis in range(3)]
"""Corners of the faces of a cube in a ring, by axis and side."""


def pack(index: NDArray[np.int64]) -> Keys:
    """Keys of integer coordinates, (..., 3) to (...)."""
    return np.asarray(index[..., 0] + (index[..., 1] << BITS) + (index[..., 2] << 2 * BITS))


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


class DualWalk:
    """Walk over the dual cubes of a balanced octree along the surface of a function.

    Parameters
    ----------
    points : (n, 3) float64
        Their cubes are the first ones.
    origin : (3,) float64
        Corner of the finest cell with coordinates (0, 0, 0).
    size : float
        Edge of a finest cell, in the unit of the points.
    levels : (n,) int64
        Leaves around a point have edges of at most ``size * 2**level``.
    top : int
        Level of the largest leaves.
    """

    def __init__(
        self,
        points: NDArray[np.float64],
        origin: NDArray[np.float64],
        size: float,
        levels: NDArray[np.int64],
        top: int,
    ) -> None:
        self.top = top
        self._refined = [np.zeros(0, np.int64)]
        index = ((points - origin) / size).astype(np.int64)
        for level in range(self.top):
            own = halve(distinct(pack(index[levels == level] >> level)), 1)
            near = (distinct(own)[:, None] + pack(AROUND)).ravel()
            # Leaves that touch differ by one level at most: all around a cell there are cells.
            touched = (self._refined[-1][:, None] + pack(AROUND[(AROUND != 0).all(axis=1)])).ravel()
            self._refined.append(distinct(np.concatenate([near, halve(distinct(touched), 1)])))
        edge = np.left_shift(1, levels)[:, None]
        corner = np.rint((points - origin) / size / edge).astype(np.int64) * edge
        self.fresh = self._cubes = distinct(pack(2 * corner))
        self._leaves, self._inside = np.zeros(0, np.int64), np.zeros(0, bool)
        self._crossed = np.zeros((0, 8), np.int64)
        self._look_around()

    def leaves(self) -> Keys:
        """Leaves that were wanted, (m,)."""
        return self._leaves

    def take_crossed(self) -> NDArray[np.int32]:
        """Leaves at the corners of the cubes with a change of sign, (c, 8)."""
        return self._crossed.astype(np.int32)

    def advance(self, inside: NDArray[np.bool_]) -> Keys:
        """Take the signs of the leaves that were wanted last; return those wanted next."""
        self._inside = np.concatenate([self._inside, inside])
        while len(self._inside) == len(self._leaves) and len(self.fresh):
            around, index = self.corners(self.fresh)
            order = np.argsort(self._leaves)
            place = order[np.searchsorted(self._leaves, around, sorter=order)]
            signs = self._inside[place][index]
            mixed = signs.any(axis=1) & ~signs.all(axis=1)
            self._crossed = np.concatenate([self._crossed, place[index[mixed]]])
            new = self.across(self.fresh, around, index, faces_crossed(signs))
            self.fresh = new[~contains(self._cubes, new)]
            self._cubes = distinct(np.concatenate([self._cubes, self.fresh]))
            self._look_around()
        return self._leaves[len(self._inside) :]

    def _look_around(self) -> None:
        around = self.corners(self.fresh)[0]
        self._leaves = np.concatenate(
            [self._leaves, around[~contains(np.sort(self._leaves), around)]]
        )

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
        found = self._leaves_at(around)
        leaves = distinct(found)
        # A row of `cells` is sorted, which makes this search a fast one.
        back = np.searchsorted(leaves, found)
        return leaves, np.stack([back[np.searchsorted(around, row)] for row in cells], axis=1)

    def _leaves_at(self, middles: Keys) -> Keys:
        """Leaves that hold the finest cells with the given middles."""
        cell = halve(middles, 1)
        leaves = middles.copy()
        left = np.arange(len(cell))
        for level in range(1, self.top + 1):
            left = left[~contains(self._refined[level], halve(cell[left], level))]
            coarse = halve(cell[left], level)
            leaves[left] = pack((2 * unpack(coarse) + 1) << level)
        return leaves

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
                half = ring & -ring & FIELD
                end = (middle + half).min(axis=1) if side else (middle - half).max(axis=1)
                step = end - (cubes[which] >> axis * BITS & FIELD)
                found.append(cubes[which] + (step << axis * BITS))
        return distinct(np.concatenate(found))


def faces_crossed(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Whether faces of cubes have corners inside and outside, (m, 3, 2) by axis and side."""
    result = np.zeros((len(inside), 3, 2), bool)
    for axis in range(3):
        for side in (0, 1):
            face = inside[:, CORNERS[:, axis] == side]
            result[:, axis, side] = face.any(axis=1) & ~face.all(axis=1)
    return result
