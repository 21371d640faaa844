"""Decimation: edges are collapsed where the surface changes least.

Garland and Heckbert, "Surface simplification using quadric error metrics" (1997). Collapses that
would change the topology (Dey et al., "Topology preserving edge contraction", 1999), flip a
triangle or make triangles intersect are omitted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import decimate as native_decimate
from o3d_sofnn.threads import thread_count


def decimate(
    vertices: NDArray[np.float64], triangles: NDArray[np.int32], target: int
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int64]]:
    """Collapse edges of a manifold, keeping its connected components, handles and borders.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A manifold, with or without borders.
    target : int
        Number of triangles to keep.

    Returns
    -------
    vertices : (v, 3) float64
    triangles : (k, 3) int32
        `target` triangles, or one less, or more if no further edge can be collapsed. No new
        intersections of triangles.
    source : (v,) int64
        For each vertex, a vertex of the input.
    """
    if target >= len(triangles):
        return vertices, triangles, np.arange(len(vertices))
    places, fewer, source = native_decimate(vertices, triangles, target, thread_count())
    return np.asarray(places), np.asarray(fewer), np.asarray(source, np.int64)


def unmet(target: int | None, count: int) -> tuple[str, ...]:
    """Return a warning if more triangles are left than the target."""
    if target is None or count <= target:
        return ()
    return (
        f"target_triangles={target} was not reached: {count} triangles are as few as the topology "
        "and sheets that must not cut each other allow: a larger voxel_size gives fewer",
    )
