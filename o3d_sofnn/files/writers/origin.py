"""A local origin: coordinates far from zero lose digits in single precision."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

# Coordinates up to this multiple of the extent lose no significant digits.
_NEAR = 4.0


def local_origin(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a point near the given ones, in round numbers; zero if they are near zero already.

    Parameters
    ----------
    points : numpy.ndarray, shape (n, 3)
        Coordinates; those that are not finite are ignored.

    Returns
    -------
    numpy.ndarray, shape (3,)
        Origin, below every coordinate by less than the extent.
    """
    finite = points[np.isfinite(points).all(axis=1)]
    if len(finite) == 0:
        return np.zeros(3)
    low, extent = finite.min(axis=0), float(np.ptp(finite, axis=0).max())
    if extent == 0.0 or np.abs(finite).max() <= _NEAR * extent:
        return np.zeros(3)
    step = 10.0 ** math.floor(math.log10(extent))
    origin: NDArray[np.float64] = np.floor(low / step) * step
    return origin
