"""Sides as seen from where the scanner stood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.orientation.winding_normals import (
    orient_points,
)
from o3d_sofnn.sampling.outliers import Samples

LEANING = 0.5
"""Most weight of the winding number's normal beside one from the rules: more turns few of them to
the right side and costs all of them accuracy."""


def directions_to(
    viewpoint: NDArray[np.float64] | None, points: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Directions from points, (n, 3), to their viewpoint, (3,) or (n, 3); None without one."""
    return None if viewpoint is None else viewpoint - points


def seen_along(directions: NDArray[np.float64], sides: NDArray[np.float64]) -> NDArray[np.float64]:
    """Join the sides that the winding number gives with those that are seen.

    The winding number is not sure of sheets that were scanned from both sides and have no rim.

    Parameters
    ----------
    directions : (n, 3) float64
        From each point to where it was seen from.
    sides : (n, 3) float64
        Unit normals of either sign.

    Returns
    -------
    (n, 3) float64
        Unit vectors between the side turned to the viewpoint and the direction to it.
    """
    return unit(turned_along(directions, sides) + unit(directions))


def leaned(
    normals: NDArray[np.float64],
    sides: NDArray[np.float64],
    share: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Lean doubtful normals towards the winding number's, which are smoother over thin parts.

    Parameters
    ----------
    normals, sides : (n, 3) float64
        Unit normals from the rules and from the winding number, zero where there is none.
    share : (n,) float64
        Weight of the second beside the first, at most one half.

    Returns
    -------
    (n, 3) float64
        Unit normals.
    """
    return unit(normals + np.minimum(share, LEANING)[:, None] * sides)


def turned_along(
    directions: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Turn normals, (n, 3), of either sign so that none looks against its direction, (n, 3)."""
    product = np.einsum("nd,nd->n", normals, directions)
    return np.where(product[:, None] < 0, -normals, normals)


def find_sides(
    samples: Samples,
    normals: NDArray[np.float64] | None,
    directions: NDArray[np.float64] | None,
    n_threads: int,
) -> NDArray[np.float64]:
    """Give every sample a side: the caller's, or that of the winding number.

    Parameters
    ----------
    samples : Samples
        The m points.
    normals : (m, 3) float64 or None
        Known normals of any length.
    directions : (m, 3) float64 or None
        From each point to where it was seen from, of any length.
    n_threads : int
        Threads.

    Returns
    -------
    (m, 3) float64
        Unit normals.
    """
    if normals is not None:
        sides = unit(normals)
    else:
        scale = samples.scale
        level, spacing = float(np.median(scale.noise)), float(np.median(scale.spacing))
        sides = orient_points(samples.points, level, spacing, n_threads)
    return sides if directions is None else seen_along(directions, sides)
