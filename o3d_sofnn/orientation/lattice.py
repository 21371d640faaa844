"""Stage 5: recognise depth images of a camera at the origin by their pixel lattice."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ASKED = 8000
"""Number of points whose pixels are examined."""


DEPTHS = 1.05
"""Smallest ratio of far to near depths: a plane that faces the camera looks like a lattice from any
place."""


SAME, WHOLE, MOST = 1e-5, 0.1, 0.95
"""Largest distance within one column, divided by the width of the image; largest deviation of a
gap from a whole number of pixels; smallest share of such gaps."""


def is_depth_image(points: NDArray[np.float64]) -> bool:
    """Return whether the points are a depth image of a camera at the origin.

    A depth camera looks along an axis of its coordinates and sees a lattice: coordinates divided by
    the depth take few values at equal distances, whatever is in front of the camera, unless the
    cloud was moved or resampled.

    Parameters
    ----------
    points : (n, 3) float64
        Points in the user's coordinates.

    Returns
    -------
    bool
    """
    some = points[np.linspace(0, len(points) - 1, min(len(points), ASKED)).astype(np.int64)]
    for axis in range(3):
        depth = np.abs(some[:, axis])
        near, far = np.quantile(depth, [0.05, 0.95])
        one_side = (some[:, axis] > 0.0).all() or (some[:, axis] < 0.0).all()
        if one_side and far > DEPTHS * near:
            across = np.delete(some, axis, axis=1) / depth[:, None]
            if _in_steps(across[:, 0]) and _in_steps(across[:, 1]):
                return True
    return False


def _in_steps(values: NDArray[np.float64]) -> bool:
    """Return whether n values take far fewer than n distinct values, at equal distances."""
    gaps = np.diff(np.sort(values))
    gaps = np.sort(gaps[gaps > SAME * np.ptp(values)])
    if not 1 < len(gaps) < 0.5 * len(values):
        return False
    pixels = gaps / gaps[len(gaps) // 10]
    return bool((np.abs(pixels - np.round(pixels)) < WHOLE).mean() >= MOST)
