"""Conversion of the faces in files to the triangles of an indexed mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.files.columns import Array

Triangles = NDArray[np.int64]


def from_polygons(counts: NDArray[Any], corners: NDArray[Any]) -> Triangles:
    """Divide polygons into fans of triangles; polygons with fewer than three corners are skipped.

    Parameters
    ----------
    counts : numpy.ndarray, shape (f,)
        Number of corners of each polygon.
    corners : numpy.ndarray, shape (sum of counts,)
        Vertex indices, one polygon after the other.

    Returns
    -------
    numpy.ndarray, shape (t, 3)
        Triangles in the order of the polygons.
    """
    counts = np.asarray(counts, dtype=np.int64)
    corners = np.asarray(corners, dtype=np.int64)
    first = np.cumsum(counts) - counts
    fans = np.maximum(counts - 2, 0)
    start = np.repeat(first, fans)
    step = np.arange(len(start)) - np.repeat(np.cumsum(fans) - fans, fans)
    return np.stack([corners[start], corners[start + step + 1], corners[start + step + 2]], axis=1)


def checked(triangles: NDArray[Any], count: int, path: Path) -> Triangles:
    """Return the triangles after checking that their corners are among ``count`` vertices.

    Raises
    ------
    ValueError
        A corner is not one of them.
    """
    if triangles.size and (triangles.min() < 0 or triangles.max() >= count):
        raise ValueError(f"{path}: expected faces of its {count} vertices, got others")
    return np.asarray(triangles, dtype=np.int64).reshape(-1, 3)


def join_vertices(points: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first of each group of equal points, in order, and the group of each point.

    Returns
    -------
    kept : numpy.ndarray, shape (m,)
        Rows of ``points``.
    index : numpy.ndarray, shape (n,)
        ``points[kept][index]`` are the points.
    """
    order = np.lexsort(points.T)
    ordered = points[order]
    is_new = np.ones(len(points), dtype=bool)
    is_new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    group = np.cumsum(is_new) - 1
    # The sort is stable: the first of a group is the first in the file.
    firsts = order[is_new]
    kept = np.sort(firsts)
    place = np.searchsorted(kept, firsts)
    index = np.zeros(len(points), dtype=np.int64)
    index[order] = place[group]
    return kept.astype(np.int64), index
