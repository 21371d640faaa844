"""The absolute lattice of a run: finest cells, bricks of cells, blocks of bricks.

Cells, and the cubes of the extraction, have the same keys whatever the bounding box, the tile or
the order of the work: a cell is named by how many edges it is away from the origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import DualWalk
from o3d_sofnn.meshing.isosurface.grid import FIELD, unpack
from o3d_sofnn.threads import thread_count

Array = NDArray[np.float64]


Keys = NDArray[np.int64]


TOP = 6
"""Level of the largest leaves: 64 finest cells."""


BLOCK = 256
"""Edge of a block in finest cells. Which leaves there are around a cell depends on the samples up
to 190 cells away, so with largest leaves of 64 no farther than one block."""


HALO = 128
"""Width of the rim around a block, in finest cells, whose rules and samples its field is made
of."""


MARGIN = 64
"""Width of the rim around a tile, in finest cells, that is meshed with it, so that its border is
repaired like its middle; then it is cut off."""


GATHERED = MARGIN + (1 << TOP) + BLOCK
"""Distance from a tile, in finest cells, up to which it needs the samples of its neighbours."""


BRICK = np.array([4, 2, 2], np.int64)
"""Leaves of one level whose winding numbers are summed together: one run of the kernel. A sum may
replace distant sources by their moments for a whole run, so that a value depends on the run."""


OFFSETS = np.stack(np.meshgrid(*map(np.arange, BRICK), indexing="ij"), axis=-1).reshape(-1, 3)
"""Cells of a brick, relative to the first one."""


@dataclass(frozen=True)
class Box:
    """Cells from `low` up to but not including `high`, (3,) int64 each."""

    low: Keys
    high: Keys

    def grown(self, width: int) -> Box:
        """Return the box with a rim around it."""
        return Box(self.low - width, self.high + width)

    def holds(self, cells: Keys) -> NDArray[np.bool_]:
        """Return whether cells or corners, (m, 3), are in the box, (m,)."""
        return np.asarray(((cells >= self.low) & (cells < self.high)).all(axis=1))


@dataclass(frozen=True)
class Lattice:
    """Cells of one edge that fill all space.

    Attributes
    ----------
    size : float
        Edge of a finest cell: one figure for the whole run.
    usual : int
        Level of the leaves where spacing and curvature are typical.
    """

    size: float
    usual: int

    def cells(self, x: Array) -> Keys:
        """Return the finest cells, (m, 3), that contain points (m, 3)."""
        return np.floor(x / self.size).astype(np.int64)

    def positions(self, middles: Keys) -> Array:
        """Return the places, (m, 3), of middles of leaves, in half cells from the origin."""
        return np.asarray(0.5 * self.size * middles)

    def box(self, low: Array, high: Array) -> Box:
        """Return the blocks nearest to a box of space; boxes that meet there meet here."""
        edge = BLOCK * self.size
        first, last = (np.rint(np.asarray(x) / edge).astype(np.int64) for x in (low, high))
        return Box(first * BLOCK, last * BLOCK)


class Leaves:
    """Leaves of the balanced octree around some samples, in one region of the lattice.

    Parameters
    ----------
    lattice : Lattice
        The lattice.
    region : Box
        Where leaves are wanted. They are the same in all regions that hold them, if all samples up
        to a block away from the region are given.
    samples : (n, 3) float64
        Points on the surface.
    levels : (n,) int64
        Leaves around a sample have edges of at most ``2**level`` cells.
    """

    def __init__(self, lattice: Lattice, region: Box, samples: Array, levels: Keys) -> None:
        self.lattice, self.region = lattice, region
        around = region.grown(2 * BLOCK)
        # Octree cells of all levels begin at multiples of their edges.
        self.base = around.low // BLOCK * BLOCK
        here = around.grown(-BLOCK).holds(lattice.cells(samples))
        # The difference is exact: a point is in the same cell whatever the base.
        self._points = np.ascontiguousarray(samples[here] / lattice.size - self.base)
        self._levels = np.ascontiguousarray(np.minimum(levels[here], TOP))

    def walk(self) -> DualWalk:
        """Start a walk through the dual cubes, beginning with those that contain the samples."""
        return DualWalk(self._points, np.zeros(3), 1.0, self._levels, TOP, thread_count())

    def middles(self, leaves: Keys) -> Keys:
        """Return the middles of leaves in half cells from the origin of the lattice, (m, 3)."""
        return unpack(leaves) + 2 * self.base

    def edges(self, leaves: Keys) -> Keys:
        """Return the edges of leaves in finest cells, (m,)."""
        return np.asarray(leaves & -leaves & FIELD)


def corners(middles: Keys, edges: Keys) -> Keys:
    """Return the octree corners that dual cubes belong to.

    Parameters
    ----------
    middles : (c, 8, 3) int64
        Middles of the leaves around each, in half cells.
    edges : (c, 8) int64
        Edges of these leaves, in cells.

    Returns
    -------
    (c, 3) int64
        In cells. Of the leaves on the upper side of an axis at least one begins at the corner.
    """
    low = (middles - edges[:, :, None]) // 2
    upper = np.arange(8)[:, None] >> np.arange(3) & 1 > 0
    return np.asarray(np.where(upper, low, np.iinfo(np.int64).min).max(axis=1))
