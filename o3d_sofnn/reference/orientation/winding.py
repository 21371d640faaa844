"""Winding numbers by direct sums: twin of ``native/orientation/winding.hpp``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

RESOLUTION = 2.0**-26
"""Smallest smoothing width, divided by the largest distance of a source from the mean of all:
positions have single precision there, and inverse powers of smaller widths overflow."""


def evaluate_winding(
    points: Array, mu: Array | None, charge: Array | None, x: Array, width: Array
) -> tuple[Array, Array, Array]:
    """Sum the fields of all dipoles and charges at every place.

    The paper leaves the sides of the normals open. Barill et al. (2018) take the winding number
    from oriented samples, Lin et al. (2024) orient samples by it. With ``d = points - x`` and
    ``r = max(|d|, width)``::

        winding   w       = sum mu.d / (4 pi r^3)
        gradient  -grad w = sum (mu / r^3 - 3 (mu.d) d / r^5) / (4 pi)
        adjoint   F       = sum charge d / (4 pi r^3)

    Within `width` the second line is not the derivative of the first, but keeps its form.

    Parameters
    ----------
    points : (n, 3) float64
        Sources.
    mu : (n, 3) float64 or None
        Area times outward normal; None for zero.
    charge : (n,) float64 or None
        Scalar sources; None for zero.
    x : (m, 3) float64
        Places.
    width : (m,) float64
        Smoothing width at each place, in the unit of the points.

    Returns
    -------
    winding : (m,) float64
    gradient : (m, 3) float64
        Downhill: outwards on a closed surface.
    adjoint : (m, 3) float64
        The transposed operator of `winding`, for equal widths and up to its sign.
    """
    size = np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    width = np.maximum(width, RESOLUTION * size)
    dipole = np.zeros_like(points) if mu is None else mu
    scalar = np.zeros(len(points)) if charge is None else charge
    winding = np.zeros(len(x))
    gradient, adjoint = np.zeros((len(x), 3)), np.zeros((len(x), 3))
    for row, place in enumerate(x):
        d = points - place
        r = np.maximum(np.linalg.norm(d, axis=1), width[row])[:, None]
        product = (dipole * d).sum(axis=1, keepdims=True)
        winding[row] = (product / r**3).sum() / (4.0 * np.pi)
        gradient[row] = (dipole / r**3 - 3.0 * product * d / r**5).sum(axis=0) / (4.0 * np.pi)
        adjoint[row] = (scalar[:, None] * d / r**3).sum(axis=0) / (4.0 * np.pi)
    return winding, gradient, adjoint
