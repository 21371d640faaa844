"""Stage 3: typical data of the cloud, one datum per rule (section 3.1), and their sides."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, divide_cells
from o3d_sofnn._kernels import typical_data as native_typical_data
from o3d_sofnn.sampling.cells import build_octree
from o3d_sofnn.sampling.local_fit import RULES_PER_NEIGHBORHOOD, sides_around
from o3d_sofnn.threads import thread_count

if TYPE_CHECKING:
    from o3d_sofnn.sampling.scales.choice import Scale

LEAF = 32
"""Smallest capacity of an octree leaf; a run of fuzzy c-means clusters the points of one leaf."""


def typical_data(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    tree: KdTree,
    scale: Scale,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Find the typical data of a cloud by fuzzy c-means in every octree leaf (section 3.1).

    A leaf that contains both sides of a thin part is divided, because a typical datum of both sides
    would lie between them.

    Parameters
    ----------
    points, normals : (n, 3) float64
        Distinct points and their unit normals, which give their sides.
    tree : KdTree
        Tree of `points`.
    scale : Scale
        Its neighbourhood size determines how many points one typical datum represents.

    Returns
    -------
    centers : (c, 3) float64
        Cluster centres; c << n if there is noise.
    sides : (c, 3) float64
        Unit normals at the centres.
    """
    # Leaves much smaller than a neighbourhood would get one rule each, however much they overlap.
    leaves = build_octree(points, max(LEAF, int(np.median(scale.n_neighbors)) // 4))
    order, offsets, facing = divide_by_side(normals[leaves.order], leaves.offsets)
    x = np.ascontiguousarray(leaves.points[order])
    count = np.diff(offsets)
    middle = x[(offsets[:-1] + offsets[1:]) // 2]
    neighbors = scale.n_neighbors[scale.at(middle)]
    clusters = np.clip(np.rint(count * RULES_PER_NEIGHBORHOOD / neighbors), 1, count)
    clusters = clusters.astype(np.int64)
    centers = np.asarray(native_typical_data(x, offsets, clusters, 8, 1e-2, thread_count()))
    facing = np.repeat(facing, clusters, axis=0)
    return centers, sides_around(centers, facing, normals, tree)


def divide_by_side(
    normals: NDArray[np.float64], offsets: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Divide cells whose normals face both ways along their main axis.

    Parameters
    ----------
    normals : (n, 3) float64
        Unit normals, cell by cell.
    offsets : (c + 1,) int64
        Cell ``i`` contains the rows ``offsets[i]`` to ``offsets[i + 1] - 1``.

    Returns
    -------
    order : (n,) int64
        Rows, arranged part by part.
    offsets : (p + 1,) int64
        Offsets of the parts.
    facing : (p, 3) float64
        Mean normal of each part.
    """
    order, size = map(np.asarray, divide_cells(normals, offsets, thread_count()))
    starts = np.stack([offsets[:-1], offsets[:-1] + size], axis=1)
    first = np.append(starts, len(normals))
    first = first[:-1][np.diff(first) > 0]
    facing = np.add.reduceat(normals[order], first)
    return order, np.append(first, len(normals)), facing
