"""Stage 3: typical data of the cloud, one for each rule (section 3.1), and their sides."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, divide_cells
from o3d_sofnn._kernels import typical_data as native_typical_data
from o3d_sofnn.sampling.cells import build_octree
from o3d_sofnn.sampling.local_fit import sides_around

if TYPE_CHECKING:
    from o3d_sofnn.sampling.scales.choice import Scale

RULES_PER_NEIGHBORHOOD = 8.0
"""Rules whose centres lie in the neighbourhood of one fit: how far neighbouring fits overlap."""


LEAF = 32
"""Fewest points in an octree leaf, the piece of data that one fuzzy c-means run sees."""


def typical_data(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    tree: KdTree,
    scale: Scale,
    n_threads: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw the typical data of the cloud: fuzzy c-means in every octree leaf (section 3.1).

    A leaf that holds both sides of a thin part is divided: a typical datum of both would lie
    between them.

    Parameters
    ----------
    points, normals : (n, 3) float64
        Distinct points and on which side of the surface they lie.
    tree : KdTree
        Over `points`.
    scale : Scale
        Its neighbourhood size says how many points one typical datum stands for.
    n_threads : int
        Threads.

    Returns
    -------
    centers : (c, 3) float64
        Cluster centres, c << n where there is noise.
    sides : (c, 3) float64
        Unit normals there.
    """
    # Leaves smaller than a neighbourhood would get one rule each, however far they overlap.
    leaves = build_octree(points, max(LEAF, int(np.median(scale.n_neighbors)) // 4))
    order, offsets, facing = divide_by_side(normals[leaves.order], leaves.offsets, n_threads)
    x = np.ascontiguousarray(leaves.points[order])
    count = np.diff(offsets)
    middle = x[(offsets[:-1] + offsets[1:]) // 2]
    neighbors = scale.n_neighbors[scale.at(middle, n_threads)]
    clusters = np.clip(np.rint(count * RULES_PER_NEIGHBORHOOD / neighbors), 1, count)
    clusters = clusters.astype(np.int64)
    centers = np.asarray(native_typical_data(x, offsets, clusters, 8, 1e-2, n_threads))
    facing = np.repeat(facing, clusters, axis=0)
    return centers, sides_around(centers, facing, normals, tree, n_threads)


def divide_by_side(
    normals: NDArray[np.float64], offsets: NDArray[np.int64], n_threads: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Divide cells whose normals face both ways along their main axis.

    Parameters
    ----------
    normals : (n, 3) float64
        Unit normals, cell by cell.
    offsets : (c + 1,) int64
        Cell ``i`` holds rows ``offsets[i]`` to ``offsets[i + 1]``.
    n_threads : int
        Threads.

    Returns
    -------
    order : (n,) int64
        Rows, part by part.
    offsets : (p + 1,) int64
        The same for the parts.
    facing : (p, 3) float64
        Mean normal of each part.
    """
    order, size = map(np.asarray, divide_cells(normals, offsets, n_threads))
    starts = np.stack([offsets[:-1], offsets[:-1] + size], axis=1)
    first = np.append(starts, len(normals))
    first = first[:-1][np.diff(first) > 0]
    facing = np.add.reduceat(normals[order], first)
    return order, np.append(first, len(normals)), facing
