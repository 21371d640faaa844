"""Sides as seen from where the scanner stood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.orientation.winding_normals import (
    orient_points,
)
from o3d_sofnn.sampling.outliers import Samples

LEANING = 0.5
"""Most weight of the winding number's normal beside one from the rules: more turns few of them to
the right side and costs all of them accuracy."""


SURE, VOTERS = 0.2, 8
"""Cosine between a normal and the direction it was seen from, from which on its side is sure; the
rest go with so many sure ones around. Less lets noise decide, more costs those seen at a slant."""


def seen_sides(
    directions: NDArray[np.float64],
    sides: NDArray[np.float64],
    places: NDArray[np.float64],
    n_threads: int,
) -> NDArray[np.float64]:
    """Turn normals to where they were seen from.

    Walls that are seen along themselves are turned as the winding number's sides around them are.

    Parameters
    ----------
    directions : (n, 3) float64
        From each place to where it was seen from, of any length; zero where that is unknown.
    sides : (n, 3) float64
        Unit normals, consistent with each other.
    places : (n, 3) float64
        Where they are.
    n_threads : int
        Number of threads.

    Returns
    -------
    (n, 3) float64
        The same normals, turned.
    """
    cosine = np.einsum("nd,nd->n", unit(directions), sides)
    turn = cosine < 0.0
    sure = np.abs(cosine) >= SURE
    weak = ~sure & (directions != 0.0).any(axis=1)
    if sure.any() and weak.any():
        tree = KdTree(np.ascontiguousarray(places[sure]), n_threads)
        asked = np.ascontiguousarray(places[weak])
        near = tree.query(asked, min(VOTERS, tree.size), np.inf, n_threads)[1]
        turn[weak] = turn[sure][near].mean(axis=1) > 0.5
    return np.where(turn[:, None], -sides, sides)


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

    The winding number is not sure of sheets that were scanned from both sides and have no rim: a
    direction from which points were seen is joined with its sides.

    Parameters
    ----------
    samples : Samples
        The m points.
    normals : (m, 3) float64 or None
        Known normals of any length.
    directions : (m, 3) float64 or None
        From each point to where it was seen from, of any length.
    n_threads : int
        Number of threads.

    Returns
    -------
    (m, 3) float64
        Unit normals.
    """
    if normals is not None:
        return unit(normals)
    scale = samples.scale
    level, spacing = float(np.median(scale.noise)), float(np.median(scale.spacing))
    sides = orient_points(samples.points, level, spacing, n_threads)
    if directions is None:
        return sides
    return unit(seen_sides(directions, sides, samples.points, n_threads) + unit(directions))
