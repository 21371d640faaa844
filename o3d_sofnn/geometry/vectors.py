"""Arithmetic on rows of vectors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BLOCK = 256
"""Number of points that are processed together: rows of three are too short for vector units."""


def bounds(x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest and highest coordinates of points (n, 3), n > 0."""
    blocks = x[: len(x) // BLOCK * BLOCK].reshape(-1, 3 * BLOCK)
    rest = x[-BLOCK:]
    if not len(blocks):
        return rest.min(axis=0), rest.max(axis=0)
    low, high = (f.reduce(blocks, axis=0).reshape(-1, 3) for f in (np.minimum, np.maximum))
    return np.minimum(low.min(axis=0), rest.min(axis=0)), np.maximum(
        high.max(axis=0), rest.max(axis=0)
    )


def longest_side(x: NDArray[np.float64]) -> float:
    """Return the longest side of the bounding box of points (n, 3), n > 0."""
    low, high = bounds(x)
    return float((high - low).max())


def unit(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scale rows to unit length; zero rows stay zero."""
    return np.asarray(x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-300))


def even_directions(count: int) -> NDArray[np.float64]:
    """Spread unit vectors, (count, 3), evenly over the sphere, along a spiral from z to -z."""
    k = np.arange(count) + 0.5
    z, turn = 1.0 - 2.0 * k / count, np.pi * (1.0 + 5.0**0.5) * k
    flat = np.sqrt(1.0 - z**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1)


SOME = 5000
"""Number of points that are examined first: a subset may suffice."""


def affine_rank(points: NDArray[np.float64]) -> int:
    """Return the dimension of the affine space that the points span."""
    if len(points) == 0:
        return 0
    if len(points) > 4 * SOME and affine_rank(points[:: len(points) // SOME]) == 3:
        return 3
    centred = points - points.mean(axis=0)
    size = float(np.abs(centred).max())
    rounding = 8.0 * np.finfo(np.float64).eps * float(np.abs(points).max())
    if size <= rounding:
        return 0
    spread = np.linalg.svd(centred / size, compute_uv=False) / np.sqrt(len(points))
    return int((spread > max(1e-9, rounding / size)).sum())
