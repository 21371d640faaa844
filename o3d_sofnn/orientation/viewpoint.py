"""Sides that face the place where the scanner stood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.orientation.winding_normals import (
    orient_points,
)
from o3d_sofnn.sampling.outliers import Samples
from o3d_sofnn.threads import thread_count

LEANING = 0.5
"""Largest weight of the winding number's normal relative to a normal from the rules: more would
correct the side of few and reduce the accuracy of all."""


SURE, VOTERS = 0.2, 8
"""Cosine between a normal and the direction to the viewpoint above which its side is certain, and
number of certain neighbours that decide the others. With a smaller cosine noise decides; a larger
one loses surfaces seen at grazing angles."""


def seen_sides(
    directions: NDArray[np.float64],
    sides: NDArray[np.float64],
    places: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Turn normals towards the place they were seen from.

    Surfaces that are seen edge-on are turned like the winding number's sides around them.

    Parameters
    ----------
    directions : (n, 3) float64
        Vectors of any length from each place to its viewpoint; zero where that is unknown.
    sides : (n, 3) float64
        Unit normals, consistent with each other.
    places : (n, 3) float64
        Positions of the normals.

    Returns
    -------
    (n, 3) float64
        The normals with their new signs.
    """
    cosine = np.einsum("nd,nd->n", unit(directions), sides)
    turn = cosine < 0.0
    sure = np.abs(cosine) >= SURE
    weak = ~sure & (directions != 0.0).any(axis=1)
    if sure.any() and weak.any():
        tree = KdTree(np.ascontiguousarray(places[sure]), thread_count())
        asked = np.ascontiguousarray(places[weak])
        near = tree.query(asked, min(VOTERS, tree.size), np.inf)[1]
        turn[weak] = turn[sure][near].mean(axis=1) > 0.5
    return np.where(turn[:, None], -sides, sides)


def leaned(
    normals: NDArray[np.float64],
    sides: NDArray[np.float64],
    share: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Blend doubtful normals with those of the winding number, which are smoother on thin parts.

    Parameters
    ----------
    normals, sides : (n, 3) float64
        Unit normals from the rules and from the winding number, zero where there is none.
    share : (n,) float64
        Weight of the normals from the winding number; at most one half is used.

    Returns
    -------
    (n, 3) float64
        Unit normals.
    """
    return unit(normals + np.minimum(share, LEANING)[:, None] * sides)


def turned_along(
    directions: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Flip normals, (n, 3), that face against their directions, (n, 3)."""
    product = np.einsum("nd,nd->n", normals, directions)
    return np.where(product[:, None] < 0, -normals, normals)


def find_sides(
    samples: Samples,
    normals: NDArray[np.float64] | None,
    directions: NDArray[np.float64] | None,
) -> NDArray[np.float64]:
    """Give every sample a side, from the caller or from the winding number.

    The winding number cannot decide sheets that were scanned from both sides and have no rim, so
    its sides are combined with the directions from which the points were seen.

    Parameters
    ----------
    samples : Samples
        The m points.
    normals : (m, 3) float64 or None
        Known normals of any length.
    directions : (m, 3) float64 or None
        Vectors of any length from each point to where it was seen from.

    Returns
    -------
    (m, 3) float64
        Unit normals.
    """
    if normals is not None:
        return unit(normals)
    scale = samples.scale
    level, spacing = float(np.median(scale.noise)), float(np.median(scale.spacing))
    sides = orient_points(samples.points, level, spacing)
    if directions is None:
        return sides
    return unit(seen_sides(directions, sides, samples.points) + unit(directions))
