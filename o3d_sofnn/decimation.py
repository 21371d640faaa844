"""Fewer triangles for the same surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def decimate(
    vertices: NDArray[np.float64], triangles: NDArray[np.int32], target: int
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int64]]:
    """Collapse edges where the surface changes least (Garland and Heckbert, 1997, by libigl).

    A collapse that would change the topology is left out: a closed manifold stays one, with the
    same pieces and handles.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A manifold, with or without borders.
    target : int
        Triangles wanted.

    Returns
    -------
    vertices : (v, 3) float64
    triangles : (k, 3) int32
        `target` of them, or one less, or as few as the topology needs if those are more.
    source : (v,) int64
        A vertex of the input for each vertex.
    """
    import igl  # of no use to most calls

    if target >= len(triangles):
        return vertices, triangles, np.arange(len(vertices))
    found, fewer, _, source = igl.qslim(vertices, triangles, target)
    return (
        np.ascontiguousarray(found, np.float64),
        np.ascontiguousarray(fewer, np.int32),
        np.asarray(source, np.int64),
    )
