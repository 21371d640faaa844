"""The field in blocks of the lattice: the same bits at a leaf, whichever tile asks.

The field of a block is made of the rules and samples in it and around it, in one canonical order,
and of the dipoles that it sees. Two tiles that share a border have the same of both for the blocks
on either side, and sum winding numbers in the same bricks of leaves, so that they find the same
values and the same triangles there.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.implicit.far_field import FarField, Level
from o3d_sofnn.implicit.field import Field
from o3d_sofnn.tiles.dipoles import CELL, Dipoles
from o3d_sofnn.tiles.lattice import BLOCK, BRICK, HALO, OFFSETS, Box, Keys, Lattice
from o3d_sofnn.tiles.patch import Patch

Array = NDArray[np.float64]


KEPT = 48
"""Number of blocks whose fields are kept for later leaves: each has some thousand samples."""


WIDEST = 1 << 20
"""Largest number of blocks along an axis, in either direction from the origin."""


@dataclass(frozen=True)
class Run:
    """Figures of a run that hold for all of its tiles.

    Attributes
    ----------
    lattice : Lattice
        The lattice.
    level : Level
        Winding number on the surface.
    noisiness : float
        From 0 to 1, if the noise level is noise.
    low, high : (3,) float64
        Wall of the domain, beyond which everything is outside.
    """

    lattice: Lattice
    level: Level
    noisiness: float
    low: Array
    high: Array


class Blocks:
    """The field at the leaves of a tile, block by block.

    Parameters
    ----------
    run : Run
        Figures of the run.
    patch : Patch
        Rules and samples of the tile and of its neighbours, up to a block and its rim away, in an
        order that is the same for all tiles: tile by tile, row by row.
    dipoles : Dipoles
        What the blocks of the tile may see, in the same order of tiles.
    """

    def __init__(self, run: Run, patch: Patch, dipoles: Dipoles) -> None:
        self._run, self._patch, self._dipoles = run, patch, dipoles
        levels = patch.samples.levels(run.lattice)
        edges = run.lattice.size * np.exp2(levels)
        self._spacing = np.maximum(patch.samples.spacing, edges)
        self._rules = _Buckets(run.lattice, patch.rules.centers)
        self._samples = _Buckets(run.lattice, patch.samples.places)
        self._known: OrderedDict[int, _Block] = OrderedDict()

    def __call__(self, middles: Keys, edges: Keys) -> tuple[Array, Array]:
        """Evaluate the field.

        Parameters
        ----------
        middles : (m, 3) int64
            Middles of leaves, in half cells from the origin of the lattice.
        edges : (m,) int64
            Edges of the leaves, in cells.

        Returns
        -------
        values, support : (m,) float64
            As of :class:`o3d_sofnn.implicit.field.Field`.
        """
        values, support = np.empty(len(middles)), np.empty(len(middles))
        block = (middles - edges[:, None]) // 2 // BLOCK
        keys = _packed(block)
        order = np.argsort(keys, kind="stable")
        starts = np.flatnonzero(np.diff(keys[order], prepend=keys[order[0]] - 1))
        for rows in np.split(order, starts[1:]):
            found = self._block(int(keys[rows[0]]), block[rows[0]])
            values[rows], support[rows] = found.evaluate(middles[rows], edges[rows])
        return values, support

    def _block(self, key: int, index: Keys) -> _Block:
        if key in self._known:
            self._known.move_to_end(key)
            return self._known[key]
        if len(self._known) >= KEPT:
            self._known.popitem(last=False)
        box = Box(index * BLOCK, (index + 1) * BLOCK)
        rim = box.grown(HALO)
        rows = self._samples.within(rim)
        patch = self._patch.taken(self._rules.within(rim), rows)
        far = self._dipoles.far_from(box)
        self._known[key] = _Block(self._run, box, patch, self._spacing[rows], far)
        return self._known[key]


class _Block:
    """The field in one block."""

    def __init__(self, run: Run, box: Box, patch: Patch, spacing: Array, dipoles: Dipoles) -> None:
        self._run, self._box = run, box
        self._bricks, self._winding = np.zeros(0, np.int64), np.zeros((0, len(OFFSETS)))
        samples = patch.samples
        places = np.concatenate([samples.places, dipoles.places])
        areas = np.concatenate([samples.areas, dipoles.areas])
        moments = np.concatenate([samples.areas[:, None] * samples.normals, dipoles.moments])
        self._far = FarField(places, areas, moments, run.level) if len(places) else None
        self._field = None
        if len(patch.rules) and len(samples.places):
            assert self._far is not None
            self._field = Field(
                patch.rules,
                patch.surfaces,
                samples.places,
                samples.normals,
                spacing,
                self._far,
                run.noisiness,
            )

    def evaluate(self, middles: Keys, edges: Keys) -> tuple[Array, Array]:
        """See :class:`Blocks`."""
        x = self._run.lattice.positions(middles)
        brick, place = self._brick_of(middles, edges)
        self._sum(np.unique(brick))
        winding = self._winding[np.searchsorted(self._bricks, brick), place]
        if self._field is None:
            usual = self._run.lattice.size * 2.0**self._run.lattice.usual
            return np.asarray(usual * (self._run.level.at(x) - winding)), np.zeros(len(x))
        return self._field.blend(x, *self._field.near(x), winding)

    def _brick_of(self, middles: Keys, edges: Keys) -> tuple[Keys, Keys]:
        """Return the keys of the bricks of some leaves, and their places in them."""
        level = np.log2(edges).astype(np.int64)
        cell = (middles - edges[:, None]) // 2 - self._box.low >> level[:, None]
        brick, at = cell // BRICK, cell % BRICK
        place = (at[:, 0] * BRICK[1] + at[:, 1]) * BRICK[2] + at[:, 2]
        x, y, z = brick.T
        return ((level * BLOCK + x) * BLOCK + y) * BLOCK + z, place

    def _sum(self, bricks: Keys) -> None:
        """Sum the winding number in all leaves of some bricks, and keep it."""
        new = bricks[~np.isin(bricks, self._bricks)]
        if not len(new):
            return
        rest, level = new, new // BLOCK**3
        index = np.stack([rest // BLOCK**2 % BLOCK, rest // BLOCK % BLOCK, rest % BLOCK], axis=1)
        cells = (index * BRICK)[:, None] + OFFSETS
        edges = np.left_shift(1, level)[:, None, None]
        x = self._run.lattice.positions(2 * (cells * edges + self._box.low) + edges).reshape(-1, 3)
        if self._far is None:
            winding = np.zeros(len(x))
        elif self._field is None:
            winding = self._far.winding_number(x, np.full(len(x), self._run.lattice.size))
        else:
            winding = self._far.winding_number(x, self._field.near(x)[1])
        bricks = np.concatenate([self._bricks, new])
        order = np.argsort(bricks)
        self._bricks = bricks[order]
        self._winding = np.concatenate([self._winding, winding.reshape(-1, len(OFFSETS))])[order]


class _Buckets:
    """Points sorted by cells as wide as the rim of a block."""

    def __init__(self, lattice: Lattice, x: Array) -> None:
        self._cells = lattice.cells(x) // CELL
        keys = _packed(self._cells // (HALO // CELL))
        self._order = np.argsort(keys, kind="stable")
        self._keys = keys[self._order]

    def within(self, box: Box) -> NDArray[np.int64]:
        """Return the indices of the points in a box of whole cells, in ascending order."""
        low, high = box.low // HALO, box.high // HALO
        axes = [np.arange(a, b) for a, b in zip(low, high, strict=True)]
        wanted = _packed(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3))
        first = np.searchsorted(self._keys, wanted, "left")
        last = np.searchsorted(self._keys, wanted, "right")
        rows = [self._order[a:b] for a, b in zip(first, last, strict=True) if b > a]
        return np.sort(np.concatenate(rows)) if rows else np.zeros(0, np.int64)


def _packed(index: Keys) -> Keys:
    """Return keys, (m,), of blocks, (m, 3), on either side of the origin."""
    x, y, z = (index + WIDEST).T
    return np.asarray((x * (2 * WIDEST) + y) * (2 * WIDEST) + z)
