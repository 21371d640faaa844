"""Sparse isosurface: cubes with data, and those that the surface enters until it closes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.meshing.isosurface.grid import AdaptiveGrid
from o3d_sofnn.meshing.isosurface.marching_cubes import marching_cubes

if TYPE_CHECKING:
    from o3d_sofnn.implicit.field import Evaluate

BLOCK = 2**18
"""Number of queries that are evaluated together: each needs about thirty numbers."""


def extract(
    evaluate: Evaluate,
    seeds: NDArray[np.float64],
    size: float,
    levels: NDArray[np.int64] | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Triangulate the zero set of a function through the cubes around some seeds.

    Starting from the cubes that contain seeds, every cube across a face with a change of sign is
    added until there is none left: the surface is closed, and components without data are never
    found. The cubes grow with the distance from the seeds.

    Parameters
    ----------
    evaluate : callable
        Maps (m, 3) queries to (m,) values, negative inside, and (m,) support.
    seeds : (n, 3) float64
        Points near the surface.
    size : float
        Edge of a finest cube.
    levels : (n,) int64, optional
        Cubes around a seed have an edge of ``size * 2**level``. None means 0.

    Returns
    -------
    vertices : (v, 3) float64
    triangles : (t, 3) int32
        A closed manifold, oriented outward.
    """
    if levels is None:
        levels = np.zeros(len(seeds), np.int64)
    grid = AdaptiveGrid(seeds, size, levels)
    walk = grid.walk()
    values = []
    wanted = np.asarray(walk.advance(np.zeros(0, bool)))
    while len(wanted):
        blocks = np.split(wanted, range(BLOCK, len(wanted), BLOCK))
        values.append(np.concatenate([_walled(evaluate, grid, block) for block in blocks]))
        wanted = np.asarray(walk.advance(values[-1] < 0.0))
    leaves, crossed = np.asarray(walk.leaves()), np.asarray(walk.take_crossed())
    del walk  # its maps are as large as all of the mesh
    return marching_cubes(np.concatenate(values), grid.positions(leaves), crossed)


def _walled(
    evaluate: Evaluate, grid: AdaptiveGrid, leaves: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Evaluate at the middles of leaves; everything beyond the wall of the domain is outside."""
    x = grid.positions(leaves)
    values, support = evaluate(x)
    edge = grid.edges(leaves)
    far = support == 0.0
    # Far away only the sign counts; beside the wall, the distance from it puts the surface there.
    values = np.where(far, values * edge, values)
    wall = np.maximum(grid.low - x, x - grid.high).max(axis=1)
    ends = far & (values < 0.0) & (wall > -2.0 * grid.size * edge)
    return np.asarray(np.where(ends, wall, np.maximum(values, wall)))
