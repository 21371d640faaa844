"""Cells of points divided by the side that these face: twin of ``native/sampling/sides.hpp``."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray


def divide_cells(
    normals: NDArray[np.float64], first: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Divide cells along the main axis of their normals, turned to the first of them.

    Parameters
    ----------
    normals : (n, 3) float64
        Unit normals, cell by cell.
    first : (c + 1,) int64
        Cell ``i`` holds rows ``first[i]`` to ``first[i + 1]``.

    Returns
    -------
    order : (n,) int64
        Rows, part by part.
    size : (c,) int64
        Rows of the first part of each cell.
    """
    order, size = [], []
    for low, high in itertools.pairwise(first):
        own = normals[low:high]
        axis = np.linalg.eigh(own.T @ own)[1][:, 2]
        ahead = own @ (axis * np.where(axis @ own[0] < 0, -1.0, 1.0)) >= 0
        order += [low + np.flatnonzero(ahead), low + np.flatnonzero(~ahead)]
        size.append(int(ahead.sum()))
    return np.concatenate(order), np.array(size)
