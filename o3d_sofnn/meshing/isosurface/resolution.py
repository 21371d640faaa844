"""Edges of the cubes, given by the user or determined by spacing, noise and curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.geometry.vectors import longest_side
from o3d_sofnn.rules.rule_base import RuleBase

SIDE = 1024
"""Number of cubes along the longest side that is always allowed, however few points a wide scene
has; an object with n points has about sqrt(n) spacings along its side."""


FEWEST = 6
"""Smallest number of cubes along the longest side: the mesh of a few points stays within one extent
of them."""


THIN = 0.6
"""Confidence in the side below which a part is so thin that its cubes are halved."""


FINER = 3
"""Number of levels by which the densest places may be finer than the median."""


SPACING = 0.75
"""Smallest edge, divided by the spacing."""


RESOLVED = 0.15
"""Smallest edge, divided by the radius of a rule: its quadric is then resolved."""


COARSER = 2.0
"""Factor of that edge where the surface is flat."""


ACCURACY = 2.0
"""Error of a fit, in units of the noise level by the square root of its number of points."""


CLEAN = 1e-3
"""Error of a fit without noise, divided by its radius."""


BENT = 0.95
"""Cosine between the normals of neighbouring rules below which the surface is not flat."""


AROUND = 9
"""Number of neighbouring rules that are examined, including the rule itself."""


DOWN = 0.4
"""Number of halvings (in levels) by which edges may be too long."""


RESOLVES = 0.5
"""Resolution of a mesh, divided by the edge of its cubes: points closer to the mesh are on it."""


SHEET = 1.2
"""Factor of the spacing for cubes along sheets and scenes, compared with solids: 1.35 times fewer
triangles, and points 1.03 to 1.08 times as far from them (6 scans)."""


def flat_edges(rules: RuleBase) -> NDArray[np.float64]:
    """Return edges of cubes in which planes are as accurate as the quadrics; 0 beside a crease.

    Parameters
    ----------
    rules : RuleBase
        Rules.

    Returns
    -------
    (r,) float64
        One edge per rule, in the unit of the points.
    """
    around = min(AROUND, len(rules))
    normals = rules.normals
    near = rules.center_tree.query(rules.centers, around, np.inf)[1]
    bent = np.einsum("rkd,rd->rk", normals[near], normals).min(axis=1) < BENT
    error = np.maximum(ACCURACY * rules.noise / np.sqrt(rules.n_neighbors), CLEAN * rules.radius)
    # A chord of this length deviates from an arc by that error.
    curvature = np.maximum(abs(rules.curvatures).max(axis=1), error / rules.radius**2)
    return np.where(bent, 0.0, np.sqrt(8.0 * error / curvature))


def choose_cubes(
    points: NDArray[np.float64],
    samples: NDArray[np.float64],
    spacing: NDArray[np.float64],
    usual_spacing: float,
    rules: RuleBase,
    voxel_size: float | None,
) -> tuple[float, float, NDArray[np.int64]]:
    """Choose the edges of the cubes along the surface.

    If the user gives a resolution, all cubes have that size. Otherwise they are as large as
    spacing, noise and curvature allow.

    Parameters
    ----------
    points : (n, 3) float64
        The cloud without its outliers: a single distant one may enlarge its box a thousand times.
    samples : (n, 3) float64
        The same points, moved onto the surface.
    spacing : (n,) float64
        Edge of the square that each point covers.
    usual_spacing : float
        Typical value of this edge.
    rules : RuleBase
        Rules.
    voxel_size : float or None
        Edge of a cube, in the unit of the points, if the user gave one.

    Returns
    -------
    size : float
        Typical edge of a cube.
    finest : float
        Edge of the finest cubes.
    levels : (n,) int64
        The cubes around a sample have an edge of ``finest * 2**level``.
    """
    if voxel_size is not None:
        return voxel_size, voxel_size, np.zeros(len(samples), np.int64)
    flat = flat_edges(rules)
    size = choose_voxel_size(points, usual_spacing, rules, flat)
    most = longest_side(points) / FEWEST
    return size, *choose_levels(samples, spacing, rules, flat, (size, most))


def choose_voxel_size(
    points: NDArray[np.float64],
    spacing: float,
    rules: RuleBase,
    flat: NDArray[np.float64],
) -> float:
    """Return the edge of a cube that suits most of the data.

    Parameters
    ----------
    points : (n, 3) float64
        The cloud without its outliers.
    spacing : float
        Edge of the square that one point covers.
    rules : RuleBase
        Rules.
    flat : (r,) float64
        What :func:`flat_edges` says of them.

    Returns
    -------
    float
        Edge in the unit of the points.
    """
    wanted = float(np.median(typical_edges(spacing, rules.radius, flat)))
    side = longest_side(points)
    finest = side / max(SIDE, 1.25 * float(np.sqrt(len(points))))
    return min(max(wanted, finest), side / FEWEST)


def typical_edges(
    spacing: float, radius: NDArray[np.float64], flat: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the edges of cubes that suit rules, (r,), by their radius and flatness."""
    least = np.maximum(SPACING * spacing, RESOLVED * radius)
    return np.asarray(np.clip(flat, least, COARSER * least))


def choose_levels(
    samples: NDArray[np.float64],
    spacing: NDArray[np.float64],
    rules: RuleBase,
    flat: NDArray[np.float64],
    sizes: tuple[float, float],
) -> tuple[float, NDArray[np.int64]]:
    """Halve or double the cubes according to the local density and curvature.

    On thin parts without noise they are halved once more, so that arms do not fall to pieces.

    Parameters
    ----------
    samples : (n, 3) float64
        Points moved onto the surface.
    spacing : (n,) float64
        Edge of the square that one point covers, at each.
    rules : RuleBase
        Rules.
    flat : (r,) float64
        What :func:`flat_edges` says of them.
    sizes : (float, float)
        Typical edge of a cube, and the longest allowed edge.

    Returns
    -------
    finest : float
        Edge of the finest cubes.
    levels : (n,) int64
        The cubes around a sample have an edge of ``finest * 2**level``.
    """
    size, most = sizes
    fits = Fits.at(rules, flat, rules.center_tree.query(samples, 1, np.inf)[1][:, 0])
    steps = steps_of(spacing, fits, size, most)
    finer = max(0, -int(steps.min()))
    return size / 2**finer, steps + finer


@dataclass(frozen=True)
class Fits:
    """What the cubes around samples depend on: of the rule nearest to each, (n,) float64.

    Attributes
    ----------
    flat : (n,) float64
        What :func:`flat_edges` says of it.
    radius, confidence : (n,) float64
        Its radius, and the confidence in its side.
    """

    flat: NDArray[np.float64]
    radius: NDArray[np.float64]
    confidence: NDArray[np.float64]

    @classmethod
    def at(cls, rules: RuleBase, flat: NDArray[np.float64], index: NDArray[np.int64]) -> Fits:
        """Return those of rules with the given indices."""
        return cls(flat[index], rules.radius[index], rules.confidence[index])


def steps_of(
    spacing: NDArray[np.float64], fits: Fits, size: float, most: float = np.inf
) -> NDArray[np.int64]:
    """Return how often the edges of cubes around samples are doubled, (n,); halved if negative.

    Parameters
    ----------
    spacing : (n,) float64
        Edge of the square that one point covers, at each.
    fits : Fits
        The rule nearest to each.
    size, most : float
        Typical edge of a cube, and the longest allowed edge.
    """
    # Wide rules must not cause gaps.
    resolved = np.minimum(RESOLVED * fits.radius, size)
    least = np.maximum(SPACING * spacing, resolved)
    wanted = np.minimum(np.clip(fits.flat, least, COARSER * least), most)
    steps = np.floor(np.log2(wanted / size) + 1.0 - DOWN).astype(np.int64)
    thin = (fits.confidence > 0.0) & (fits.confidence < THIN) & (SPACING * spacing >= resolved)
    return np.maximum(steps - thin, -FINER)
