"""Triangles of one tile: closed by a wall around its margin, with exact seams inside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import marching_cubes
from o3d_sofnn.meshing.isosurface.extraction import BLOCK as QUERIES
from o3d_sofnn.meshing.isosurface.marching_cubes import EDGE_ENDS, NUDGES, both_tables
from o3d_sofnn.tiles.lattice import MARGIN, Box, Keys, Leaves, corners

if TYPE_CHECKING:
    from o3d_sofnn.tiles.blocks import Blocks, Run
    from o3d_sofnn.tiles.patch import Patch

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Extracted:
    """Closed mesh of a tile and its margin.

    Attributes
    ----------
    vertices : (v, 3) float64
        Vertices as marching cubes places them: those on a seam have the same bits in all tiles.
    away : (v, 3) float64
        The same, farther from the nodes where cubes have corners that coincide: without
        intersections, and likewise the same on both sides of a seam.
    triangles : (t, 3) int32
        The tile's own triangles first.
    n_own : int
        Number of these.
    """

    vertices: Array
    away: Array
    triangles: NDArray[np.int32]
    n_own: int

    @property
    def seam(self) -> NDArray[np.int64]:
        """Vertices between own triangles and others, in an order that is the same in all tiles."""
        own, other = (np.zeros(len(self.vertices), bool) for _ in range(2))
        own[self.triangles[: self.n_own]] = True
        other[self.triangles[self.n_own :]] = True
        rows = np.flatnonzero(own & other)
        return np.asarray(rows[np.lexsort(self.vertices[rows].T)])


def extract(run: Run, own: Box, patch: Patch, blocks: Blocks) -> Extracted:
    """Triangulate the zero set in the cubes of a tile and in a rim around it.

    Parameters
    ----------
    run : Run
        Figures of the run.
    own : Box
        The tile: cubes whose corner is in it are its own.
    patch : Patch
        Samples of the tile and of its neighbours.
    blocks : Blocks
        The field.

    Returns
    -------
    Extracted
    """
    region = own.grown(MARGIN)
    grid = Leaves(run.lattice, region, patch.samples.places, patch.samples.levels(run.lattice))
    walk, values = grid.walk(), [np.zeros(0)]
    wanted = np.asarray(walk.advance(np.zeros(0, bool)))
    while len(wanted):
        parts = np.split(wanted, range(QUERIES, len(wanted), QUERIES))
        values.append(np.concatenate([_walled(run, grid, blocks, part) for part in parts]))
        wanted = np.asarray(walk.advance(values[-1] < 0.0))
    leaves, crossed = np.asarray(walk.leaves()), np.asarray(walk.take_crossed())
    return _triangulated(run, own, grid, leaves, crossed, np.concatenate(values))


def _walled(run: Run, grid: Leaves, blocks: Blocks, leaves: Keys) -> Array:
    """Evaluate at leaves; beyond the wall of the domain, and of this tile, is outside."""
    middles, edges = grid.middles(leaves), grid.edges(leaves)
    x, size = run.lattice.positions(middles), run.lattice.size
    region = grid.region
    beyond = np.maximum(2 * region.low - middles, middles - 2 * region.high).max(axis=1)
    result = 0.5 * size * (beyond + 1.0)
    here = beyond < 0
    if here.any():
        values, support = blocks(middles[here], edges[here])
        edge, far, x = edges[here], support == 0.0, x[here]
        # Far away only the sign counts; beside the wall, the distance from it puts the surface
        # there.
        values = np.where(far, values * edge, values)
        wall = np.maximum(run.low - x, x - run.high).max(axis=1)
        ends = far & (values < 0.0) & (wall > -2.0 * size * edge)
        result[here] = np.where(ends, wall, np.maximum(values, wall))
    return np.asarray(result)


def _triangulated(
    run: Run, own: Box, grid: Leaves, leaves: Keys, crossed: NDArray[np.int32], values: Array
) -> Extracted:
    """Triangulate cubes in an order that does not depend on the walk."""
    middles, edges = grid.middles(leaves), grid.edges(leaves)
    if not len(crossed):
        nothing = np.zeros((0, 3))
        return Extracted(nothing, nothing, np.zeros((0, 3), np.int32), 0)
    place = corners(middles[crossed], edges[crossed])
    # Where a vertex is rounded to depends on which end of its edge comes first.
    order = np.lexsort(middles.T)
    number = np.empty(len(order), np.int32)
    number[order] = np.arange(len(order), dtype=np.int32)
    is_own = own.holds(place)
    turn = np.lexsort((*place.T, ~is_own))
    cubes, is_own = np.ascontiguousarray(number[crossed[turn]]), is_own[turn]
    nodes = np.ascontiguousarray(run.lattice.positions(middles[order]))
    values = np.ascontiguousarray(values[order])
    tables = (*both_tables(), EDGE_ENDS, NUDGES)
    vertices, triangles, uneven, inner = map(
        np.asarray, marching_cubes(values, nodes, cubes, *tables)
    )
    mine = np.ascontiguousarray(cubes[is_own])
    n_own = len(np.asarray(marching_cubes(values, nodes, mine, *tables)[1]))
    away = vertices.copy()
    away[uneven] = inner
    return Extracted(vertices, away, triangles, n_own)
