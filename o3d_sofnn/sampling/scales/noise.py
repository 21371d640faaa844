"""Noise level from the residuals of local fits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

TRUNCATED, POWER = 0.36, 2.6
"""Residual divided by the radius of a fit to points that fill its ball, and exponent of the share
of Gaussian noise that such a ball cuts off (simulated)."""


LARGEST = 0.5
"""Ratio to the former up to which the noise is corrected for truncation: above it, the ball may
contain a second sheet."""


def untruncated(rms: NDArray[np.float64], radius: NDArray[np.float64]) -> NDArray[np.float64]:
    """Correct residuals for the part of the noise that lies outside the balls of the fits.

    Parameters
    ----------
    rms, radius : (...) float64
        Residuals of quadric fits and their radii.

    Returns
    -------
    (...) float64
        Standard deviation of the noise: equal to `rms` where that is much smaller than the radius,
        elsewhere up to 1.1 times as large.
    """
    ratio = np.minimum(rms / np.maximum(radius, 1e-300), LARGEST * TRUNCATED)
    return np.asarray(rms / np.sqrt(1.0 - (ratio / TRUNCATED) ** POWER))


def noise_level(
    fine: NDArray[np.float64],
    coarse: NDArray[np.float64],
    n_fine: NDArray[np.int64],
    n_coarse: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Separate noise from shape in the residuals of quadric fits at two scales.

    Noise leaves the same residual at every scale. The part of the shape that a quadric misses grows
    with the cube of the radius, so its square grows with the cube of the number of points.

    Parameters
    ----------
    fine, coarse : (p,) float64
        Root-mean-square residuals.
    n_fine, n_coarse : (p,) int64
        Number of points in the fits.

    Returns
    -------
    (p,) float64
        Standard deviation of the noise.
    """
    ratio = (n_fine / n_coarse) ** 3.0
    rest = (fine**2 - ratio * coarse**2) / np.maximum(1.0 - ratio, 1e-3)
    return np.sqrt(np.maximum(rest, 0.0))
