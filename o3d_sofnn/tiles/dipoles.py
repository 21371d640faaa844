"""A tree of dipoles: the samples of a tile as seen from farther and farther away.

Samples are summed in cells of the absolute lattice, these in cells twice as wide, and so on. Seen
from a block, a cell counts as one dipole if it is at least :data:`APART` of its edges away; cells
closer than that are divided, and those of the finest level replaced by the samples themselves.
Which dipoles a block sees, and in which order, depends on the block alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.tiles.lattice import HALO, Box, Keys, Lattice

Array = NDArray[np.float64]


APART = 2
"""Distance of a cell from a block, divided by the cell's edge, from which it counts as one
dipole."""


CELL = HALO // APART
"""Edge of a cell of the finest level, in finest cells of the lattice: those that count as samples
are then within the rim of a block."""


LEVELS = 24
"""Largest number of levels."""


@dataclass(frozen=True)
class Dipoles:
    """Dipoles of cells, tile by tile, from fine to coarse.

    Attributes
    ----------
    cells : (c, 3) int64
        Cells, in units of their edges from the origin of the lattice.
    level : (c,) int64
        Their edges are ``CELL * 2**level`` finest cells.
    last : (c,) bool
        Cells of the coarsest level of a tile.
    places : (c, 3) float64
        Middle of the samples, weighted by area.
    areas : (c,) float64
        Area of the samples.
    moments : (c, 3) float64
        Sum of the samples' normals, each as long as its area.
    """

    cells: Keys
    level: Keys
    last: NDArray[np.bool_]
    places: Array
    areas: Array
    moments: Array

    def __len__(self) -> int:
        """Return the number of dipoles."""
        return len(self.level)

    def seen_from(self, box: Box) -> Dipoles:
        """Return what the blocks in a box may need: fine ones near it, coarse ones far away."""
        return self._rows(self.last | (self._distance(box, 1) < 2 * APART))

    def far_from(self, box: Box) -> Dipoles:
        """Return the dipoles that one block sees: every sample is in one, or in a near cell."""
        far = self._distance(box, 0) >= APART
        return self._rows(far & (self.last | (self._distance(box, 1) < 2 * APART)))

    def _distance(self, box: Box, up: int) -> NDArray[np.int64]:
        """Return the distance of the cells' ancestors from a box, in units of the cells' edges."""
        edge = CELL << self.level
        cells = self.cells >> up << up
        low, high = cells * edge[:, None], (cells + (1 << up)) * edge[:, None]
        apart = np.maximum(box.low - high, low - box.high).max(axis=1)
        return np.asarray(apart // edge)

    def _rows(self, mask: NDArray[np.bool_]) -> Dipoles:
        return Dipoles(**{name: value[mask] for name, value in vars(self).items()})


FEW = 64
"""Number of cells in a level from which on the levels of a tile are seen from afar."""


@dataclass(frozen=True)
class Coarse:
    """The coarse levels of the dipoles of a tile, and where they suffice.

    Attributes
    ----------
    number : int
        The tile.
    dipoles : Dipoles
        Levels of at most `FEW` cells.
    low, high : (3,) int64
        Box of all cells, in finest cells of the lattice.
    edge : int
        Edge of the cells of the finest of these levels; 0 if there are no finer ones.
    """

    number: int
    dipoles: Dipoles
    low: Keys
    high: Keys
    edge: int

    @classmethod
    def of(cls, number: int, dipoles: Dipoles) -> Coarse:
        """Return the coarse levels of all dipoles of a tile."""
        count = np.bincount(dipoles.level, minlength=1)
        first = int(np.argmax(count <= FEW))
        edge = (CELL << dipoles.level)[:, None]
        low, high = (dipoles.cells * edge), (dipoles.cells + 1) * edge
        finest = dipoles.level == 0
        none = np.zeros(3, np.int64)
        return cls(
            number,
            dipoles._rows(dipoles.level >= first),
            low[finest].min(axis=0) if finest.any() else none,
            high[finest].max(axis=0) if finest.any() else none,
            CELL << first if first else 0,
        )

    def suffices(self, box: Box) -> bool:
        """Return whether all blocks in a box see nothing finer: no finer cell has a near parent."""
        apart = int(np.maximum(box.low - self.high, self.low - box.high).max())
        return not self.edge or apart >= APART * self.edge


def dipoles_of(lattice: Lattice, places: Array, areas: Array, normals: Array) -> Dipoles:
    """Sum samples in cells of the lattice.

    Parameters
    ----------
    lattice : Lattice
        The lattice.
    places, normals : (n, 3) float64
        Samples and their unit normals.
    areas : (n,) float64
        Area that each represents.
    """
    found = []
    cells = lattice.cells(places) // CELL
    moments = areas[:, None] * normals
    for level in range(LEVELS):
        cells, row = np.unique(cells, axis=0, return_inverse=True)
        row = row.ravel().astype(np.int64)
        areas, before = np.asarray(np.bincount(row, areas, len(cells))), areas
        places = (
            _sums(row, before[:, None] * places, len(cells)) / np.maximum(areas, 1e-300)[:, None]
        )
        moments = _sums(row, moments, len(cells))
        # What is on two sides of the origin never meets in one cell.
        last = len(cells) <= 1 or bool(((cells == 0) | (cells == -1)).all()) or level == LEVELS - 1
        levels, lasts = np.full(len(cells), level), np.full(len(cells), last)
        found.append(Dipoles(cells, levels, lasts, places, areas, moments))
        if last:
            break
        cells = cells // 2
    return joined(found)


def joined(parts: Sequence[Dipoles]) -> Dipoles:
    """Join dipoles in their order."""
    return Dipoles(
        **{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])}
    )


def _sums(row: NDArray[np.int64], values: Array, count: int) -> Array:
    return np.stack([np.bincount(row, column, count) for column in values.T], axis=1)
