"""Cells of an absolute lattice that absorb points: memory grows with the surface, not with them.

A cell keeps the number of its points and the sums of their positions, so that the order in which
points arrive does not matter, and points that arrive twice add nothing but weight.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.threads import thread_count

Array = NDArray[np.float64]


FINER = 0.5
"""Edge of a cell, divided by the spacing of the first sweep where it is dense: up to four cells for
each of its points, so that later sweeps add detail."""


DENSE = 0.1
"""Share of the places of the first sweep that may be denser than that."""


ASKED, NEIGHBORS = 2000, 8
"""Places at which the spacing is measured, and points around each."""


@dataclass(frozen=True)
class Cells:
    """What points have left in their cells.

    Attributes
    ----------
    edge : float
        Edge of the cells, a power of two, in the unit of the points.
    keys : (m, 3) int64
        Cells in lexicographic order: they reach from ``edge * key`` to ``edge * (key + 1)``.
    count : (m,) int64
        Number of points that each has absorbed.
    offset : (m, 3) float64
        Sum of the differences of the points from the middle of the cell, divided by the edge.
    seen : (m,) int64
        Number of those points of which it is known where they were seen from.
    place : (m, 3) float64
        Sum of the places that they were seen from.
    """

    edge: float
    keys: NDArray[np.int64]
    count: NDArray[np.int64]
    offset: Array
    seen: NDArray[np.int64]
    place: Array

    def __len__(self) -> int:
        """Return the number of cells."""
        return len(self.keys)

    @classmethod
    def of(cls, points: Array, edge: float, viewpoint: Array | None = None) -> Cells:
        """Absorb points, (n, 3), all seen from one place, (3,), or each from its own, (n, 3)."""
        keys = np.floor(points / edge).astype(np.int64)
        n = len(points)
        seen = np.full(n, viewpoint is not None, np.int64)
        place = np.broadcast_to(0.0 if viewpoint is None else viewpoint, (n, 3)).astype(float)
        offset = points / edge - (keys + 0.5)
        return _grouped(cls(edge, keys, np.ones(n, np.int64), offset, seen, place))

    def checked(self) -> Cells:
        """Return these cells, or raise ``ValueError`` if they cannot be what points have left."""
        m = len(self.keys)
        wanted = {"keys": (m, 3), "count": (m,), "offset": (m, 3), "seen": (m,), "place": (m, 3)}
        fits = all(getattr(self, name).shape == shape for name, shape in wanted.items())
        if not (fits and 0.0 < self.edge < np.inf and (self.count > 0).all()):
            raise ValueError("expected the cells of points")
        if not (np.isfinite(self.offset).all() and np.isfinite(self.place).all()):
            raise ValueError("expected finite cells")
        return self

    @property
    def points(self) -> Array:
        """Mean of the points of each cell, (m, 3)."""
        return self.edge * (self.keys + 0.5 + self.offset / self.count[:, None])

    @property
    def viewpoint(self) -> Array | None:
        """Where the points of each cell were seen from, (m, 3); None unless it is known of all."""
        if not len(self) or not self.seen.all():
            return None
        return np.asarray(self.place / self.seen[:, None])

    def joined(self, other: Cells) -> Cells:
        """Return what the points of both have left."""
        pairs = [(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)[1:]]
        return _grouped(Cells(self.edge, *(np.concatenate(pair) for pair in pairs)))

    def without(self, low: Array, high: Array) -> Cells:
        """Return the cells whose mean lies outside a box with the corners `low` and `high`."""
        x = self.points
        kept = ~((x >= low) & (x <= high)).all(axis=1)
        return Cells(self.edge, *(getattr(self, f.name)[kept] for f in fields(self)[1:]))


def _grouped(cells: Cells) -> Cells:
    """Sort cells, and add up those with equal keys."""
    order = np.lexsort(cells.keys.T[::-1])
    keys = cells.keys[order]
    first = np.ones(len(keys), bool)
    first[1:] = (keys[1:] != keys[:-1]).any(axis=1)
    start = np.flatnonzero(first)
    if not len(start):
        return cells
    sums = (
        np.add.reduceat(x[order], start)
        for x in (cells.count, cells.offset, cells.seen, cells.place)
    )
    return Cells(cells.edge, keys[start], *sums)


def edge_for(points: Array) -> float:
    """Choose the edge of cells for a first sweep: a power of two, so that similar sweeps agree.

    Parameters
    ----------
    points : (n, 3) float64
        The sweep.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        All points are equal.
    """
    distinct = np.unique(points, axis=0)
    count = min(NEIGHBORS, len(distinct) - 1)
    if count < 1:
        raise ValueError("pcd: expected at least two distinct points, got one")
    middle = distinct.mean(axis=0)
    extent = float(np.ptp(distinct, axis=0).max())
    x = np.ascontiguousarray((distinct - middle) / extent)
    rows = np.linspace(0, len(x) - 1, min(len(x), ASKED)).astype(np.int64)
    tree = KdTree(x, thread_count())
    reach = np.asarray(tree.query(x[rows], count + 1, np.inf)[0])[:, -1]
    spacing = float(np.quantile(reach, DENSE)) * np.sqrt(np.pi / count) * extent
    return float(2.0 ** np.floor(np.log2(FINER * spacing)))
