"""Sides as seen from where the scanner stood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.orientation.winding_normals import (
    orient_points,
)
from o3d_sofnn.sampling.scale import Scale

LEANING = 0.5
"""Most weight of the winding number's normal beside one from the rules: more turns few of them to
the right side and costs all of them accuracy."""


def seen_from(
    viewpoint: NDArray[np.float64], points: NDArray[np.float64], sides: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Join the sides that the winding number gives with those that are seen.

    The winding number is not sure of sheets that were scanned from both sides and have no rim.

    Parameters
    ----------
    viewpoint : (3,) or (n, 3) float64
        Position of the scanner, for all points or for each of them.
    points, sides : (n, 3) float64
        Points and unit normals of either sign.

    Returns
    -------
    (n, 3) float64
        Unit vectors between the side turned to the viewpoint and the direction to it.
    """
    return unit(turned_to(viewpoint, points, sides) + unit(viewpoint - points))


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


def turned_to(
    viewpoint: NDArray[np.float64],
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Turn normals to where they were seen from.

    Parameters
    ----------
    viewpoint : (3,) or (n, 3) float64
        Position of the scanner, for all points or for each of them.
    points : (n, 3) float64
        Points.
    normals : (n, 3) float64
        Their normals, of either sign.

    Returns
    -------
    (n, 3) float64
        None has a negative product with the direction to its viewpoint.
    """
    product = np.einsum("nd,nd->n", normals, viewpoint - points)
    return np.where(product[:, None] < 0, -normals, normals)


def find_sides(
    points: NDArray[np.float64],
    normals: NDArray[np.float64] | None,
    viewpoint: NDArray[np.float64] | None,
    rows: NDArray[np.int64],
    clean: NDArray[np.float64],
    scale: Scale,
    threads: int,
) -> NDArray[np.float64]:
    """Give the inliers, `rows` of the cloud, unit normals: the caller's or the winding number's."""
    if normals is None:
        level, spacing = float(np.median(scale.noise)), float(np.median(scale.spacing))
        sides = orient_points(clean, level, spacing, threads)
    else:
        sides = unit(normals[rows])
    if viewpoint is None:
        return sides
    places = viewpoint[rows] if viewpoint.ndim == 2 else viewpoint
    return seen_from(places, points[rows], sides)
