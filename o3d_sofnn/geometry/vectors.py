"""Arithmetic on rows of vectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BLOCK = 256
"""Points that are looked at together: rows of three numbers are too short for vector units."""


def bounds(x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest coordinates of points (n, 3), n > 0."""
    blocks = x[: len(x) // BLOCK * BLOCK].reshape(-1, 3 * BLOCK)
    rest = x[-BLOCK:]
    if not len(blocks):
        return rest.min(axis=0), rest.max(axis=0)
    low, high = (f.reduce(blocks, axis=0).reshape(-1, 3) for f in (np.minimum, np.maximum))
    return np.minimum(low.min(axis=0), rest.min(axis=0)), np.maximum(
        high.max(axis=0), rest.max(axis=0)
    )


def longest_side(x: NDArray[np.float64]) -> float:
    """Longest side of the bounding box of points (n, 3), n > 0."""
    low, high = bounds(x)
    return float((high - low).max())


def unit(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows of unit length, zeros stay."""
    return np.asarray(x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-300))
