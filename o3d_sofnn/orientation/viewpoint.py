"""Stage 5: sides of points, from the winding number and from where they were seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, WindingTree
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.orientation.winding_normals import OPENING, winding_number_normals
from o3d_sofnn.sampling.outliers import Samples
from o3d_sofnn.sampling.representatives import local_spacing, representatives
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


COARSE, FINE = (1.5, 3.0), (0.7, 2.3)
"""Smoothing width at the beginning and at the end: these multiples of the distance between
representatives and of the noise level, combined as a root of squares. With a smaller width the
noise decides; with a larger one thin parts vanish."""


WEIGHT = 0.75
"""Power of its area with which a representative counts. With 0, dense spots decide about sparse
parts around them; with 1, a few points far apart do, and noise counts more."""


BLURRED = (0.5, 1.0)
"""Noise divided by the spacing above which that power falls, and above which it is zero: distances
between representatives are then noise as well. At 1 % noise, 0.1 % fewer normals of twelve shapes
are flipped."""


BLUR = 3.8
"""Smoothing width of the gradient at the points, divided by the noise."""


UNEVEN, DISPUTED = 2.0, 0.05
"""Ratio of the upper to the lower tenth of the spacings of representatives above which their sides
are found once more, all counting the same; share of the surface on which both differ that makes
the sides doubtful. Where they are right, at most 0.035 differs; 0.1 and 0.29 where they are not."""


@dataclass(frozen=True)
class Oriented:
    """Sides of n points.

    Attributes
    ----------
    normals : (n, 3) float64
        Unit normals.
    disputed : (n,) bool
        Where another way to count the representatives finds the opposite side, if that is so on
        much of the surface.
    share : float
        That share of the surface, or 0.
    """

    normals: NDArray[np.float64]
    disputed: NDArray[np.bool_]
    share: float

    @classmethod
    def known(cls, normals: NDArray[np.float64]) -> Oriented:
        """Return sides that nobody disputes."""
        return cls(normals, np.zeros(len(normals), bool), 0.0)

    @property
    def warnings(self) -> tuple[str, ...]:
        """A warning, if the sides are doubtful."""
        if not self.share:
            return ()
        return (
            f"the density is very uneven, and the sides of {100.0 * self.share:.0f} % of the "
            "surface depend on how dense and sparse parts are weighed: their confidence is 0. Thin "
            "the cloud to an even spacing, or give viewpoint or towards",
        )


def orient_points(points: NDArray[np.float64], noise: float, spacing: float) -> Oriented:
    """Find outward normals at all points by a global criterion alone.

    The winding number normals of representatives, which count as if they were even in space,
    define a smooth winding number; its gradient is evaluated at all points. Since no local fit is
    used, the two sides are distinguished even on parts hardly thicker than the noise, where a fit
    would contain both sides.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points in Morton order.
    noise : float
        Standard deviation of the points from the surface.
    spacing : float
        Edge of the square that one point covers.

    Returns
    -------
    Oriented
        On an open sheet without a preferred side, the sign of the normals is arbitrary.
    """
    x, stands = representatives(points, noise, spacing)
    tree = KdTree(x, thread_count())
    distance = local_spacing(x, tree)
    coarse, fine = (np.hypot(a * distance, b * noise) for a, b in (COARSE, FINE))
    areas = distance**2
    low, high = BLURRED
    power = WEIGHT * float(np.clip((high - noise / spacing) / (high - low), 0.0, 1.0))
    mu = winding_number_normals(x, areas, areas**power, coarse, fine)
    sources = WindingTree(x, np.linalg.norm(mu, axis=1), thread_count())
    width = np.maximum(fine, BLUR * noise)[stands]
    normals = unit(np.asarray(sources.gradient(mu, points, width, OPENING)[1]))
    low, high = np.quantile(distance, [0.1, 0.9])
    if high <= UNEVEN * low:
        return Oriented.known(normals)
    other = winding_number_normals(x, areas, np.ones(len(x)), coarse, fine)
    against = np.einsum("md,md->m", mu, other) < 0.0
    share = float(areas[against].sum() / areas.sum())
    if share <= DISPUTED:
        return Oriented.known(normals)
    return Oriented(normals, against[stands], share)


def find_sides(
    samples: Samples,
    normals: NDArray[np.float64] | None,
    directions: NDArray[np.float64] | None,
) -> Oriented:
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
    Oriented
        Undisputed where the caller knows where the points were seen from.
    """
    if normals is not None:
        return Oriented.known(unit(normals))
    scale = samples.scale
    level, spacing = float(np.median(scale.noise)), float(np.median(scale.spacing))
    oriented = orient_points(samples.points, level, spacing)
    if directions is None:
        return oriented
    sides = seen_sides(directions, oriented.normals, samples.points)
    return Oriented.known(unit(sides + unit(directions)))
