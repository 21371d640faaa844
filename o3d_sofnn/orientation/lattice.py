"""Stage 5: clouds that a camera at the origin has made: their pixels are still there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

ASKED = 8000
"""Points whose pixels are looked at."""


DEPTHS = 1.05
"""Least ratio of the far depths to the near ones: of a plane that faces the camera any place sees a
lattice."""


SAME, WHOLE, MOST = 1e-5, 0.1, 0.95
"""Distance of columns, over the width of the picture, that are the same one; largest distance of a
gap from a whole number of pixels; least share of gaps like that."""


def is_depth_image(points: NDArray[np.float64]) -> bool:
    """Tell whether a camera at the origin has made the points.

    A depth camera looks along an axis of its coordinates and sees a lattice: the coordinates over
    the depth are few numbers at equal distances, whatever is in front of the camera, as long as
    nobody moves or resamples the cloud.

    Parameters
    ----------
    points : (n, 3) float64
        In the user's coordinates.

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
    """Whether the values, (n,), are much fewer than n, at equal distances."""
    gaps = np.diff(np.sort(values))
    gaps = np.sort(gaps[gaps > SAME * np.ptp(values)])
    if not 1 < len(gaps) < 0.5 * len(values):
        return False
    pixels = gaps / gaps[len(gaps) // 10]
    return bool((np.abs(pixels - np.round(pixels)) < WHOLE).mean() >= MOST)
