"""Octrees of the extraction with random levels."""

from __future__ import annotations

import numpy as np

from o3d_sofnn import reference
from o3d_sofnn.meshing.isosurface.grid import AdaptiveGrid
from o3d_sofnn.reference.meshing.grid import contains, distinct


def random_grid(seed):
    """A grid with random levels around random places, and all its dual cubes near them."""
    rng = np.random.default_rng(seed)
    points = np.concatenate([rng.uniform(0.0, 1.0, (6, 3)), [[0.0] * 3, [1.0] * 3]])
    levels = rng.integers(0, 4, len(points))
    grid = AdaptiveGrid(points, 1 / 48, levels)
    walk = reference.DualWalk(points, grid.origin, grid.size, levels, grid.top)
    cubes = fresh = walk.fresh
    while len(fresh):
        leaves, index = walk.corners(fresh)
        place = grid.positions(leaves)[index]
        inside = ((place > grid.low - 0.2) & (place < grid.high + 0.2)).all(axis=(1, 2))
        crossed = np.broadcast_to(inside[:, None, None], (len(fresh), 3, 2))
        fresh = walk.across(fresh, leaves, index, crossed)
        fresh = fresh[~contains(cubes, fresh)]
        cubes = distinct(np.concatenate([cubes, fresh]))
    return rng, grid, walk, cubes
