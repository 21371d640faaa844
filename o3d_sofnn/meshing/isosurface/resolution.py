"""Edges of the cubes: what the user wants, or what spacing, noise and curvature ask for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.geometry.vectors import longest_side
from o3d_sofnn.rules.rule_base import RuleBase

SIDE = 1024
"""Cubes along the longest side that are never too many, however few points a wide scene has; an
object with n points has about sqrt(n) spacings along its side."""


FEWEST = 6
"""Cubes along the longest side that are never too few, wherever: the mesh of a handful of points
stays within an extent of them."""


THIN = 0.6
"""Confidence in the side below which a part is hardly thicker than the cubes, which are halved."""


FINER = 3
"""Levels that the densest places may be finer than the median."""


SPACING = 0.75
"""Least edge, over the spacing."""


RESOLVED = 0.15
"""Least edge, over the radius of a rule: its quadric is resolved."""


COARSER = 2.0
"""Times that edges are longer than that where the surface is flat."""


ACCURACY = 2.0
"""Error of a fit, over the noise and over the root of its number of points."""


CLEAN = 1e-3
"""Error of a fit without noise, over its radius."""


BENT = 0.95
"""Cosine between the normals of neighbouring rules below which the surface is not flat."""


AROUND = 9
"""Neighbouring rules that are looked at, itself included."""


DOWN = 0.4
"""Part of a halving that edges may be too long by."""


RESOLVES = 0.5
"""Distance that a mesh resolves, over the edge of its cubes: what lies nearer is on it."""


SHEET = 1.2
"""Spacing over that on solids for the cubes along sheets and scenes: 1.35 times fewer triangles,
points 1.03 to 1.08 times as far from them (6 scans)."""


def flat_edges(rules: RuleBase, n_threads: int) -> NDArray[np.float64]:
    """Edges of cubes in which planes are as good as the quadrics are accurate; 0 beside an edge.

    Parameters
    ----------
    rules : RuleBase
        Rules.
    n_threads : int
        Number of threads.

    Returns
    -------
    (r,) float64
        One a rule, in the unit of the points.
    """
    around = min(AROUND, len(rules))
    normals = rules.normals
    near = KdTree(rules.centers, n_threads).query(rules.centers, around, np.inf, n_threads)[1]
    bent = np.einsum("rkd,rd->rk", normals[near], normals).min(axis=1) < BENT
    error = np.maximum(ACCURACY * rules.noise / np.sqrt(rules.n_neighbors), CLEAN * rules.radius)
    # A chord of this length leaves an arc by that much.
    curvature = np.maximum(abs(rules.curvatures).max(axis=1), error / rules.radius**2)
    return np.where(bent, 0.0, np.sqrt(8.0 * error / curvature))


def choose_cubes(
    points: NDArray[np.float64],
    samples: NDArray[np.float64],
    spacing: NDArray[np.float64],
    usual_spacing: float,
    rules: RuleBase,
    voxel_size: float | None,
    n_threads: int,
) -> tuple[float, float, NDArray[np.int64]]:
    """Edges of the cubes along the surface.

    Who gives a resolution gets it: all cubes are then of that size. Else they are as large as
    spacing, noise and curvature allow.

    Parameters
    ----------
    points : (n, 3) float64
        The cloud without its outliers: a single one far away may make its box a thousand times as
        large.
    samples : (n, 3) float64
        The same, moved onto the surface.
    spacing : (n,) float64
        Edge of the square that one point covers, at each.
    usual_spacing : float
        The same where the data is as usual.
    rules : RuleBase
        Rules.
    voxel_size : float or None
        Edge of a cube, in the unit of the points, if the user has given one.
    n_threads : int
        Number of threads.

    Returns
    -------
    size : float
        Edge of a cube where the data is as usual.
    finest : float
        Edge of the finest cubes.
    levels : (n,) int64
        The cubes around a sample have an edge of ``finest * 2**level``.
    """
    if voxel_size is not None:
        return voxel_size, voxel_size, np.zeros(len(samples), np.int64)
    flat = flat_edges(rules, n_threads)
    size = choose_voxel_size(points, usual_spacing, rules, flat)
    most = longest_side(points) / FEWEST
    return size, *choose_levels(samples, spacing, rules, flat, (size, most), n_threads)


def choose_voxel_size(
    points: NDArray[np.float64],
    spacing: float,
    rules: RuleBase,
    flat: NDArray[np.float64],
) -> float:
    """Edge of a cube that most of the data asks for.

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
        In the unit of the points.
    """
    least = np.maximum(SPACING * spacing, RESOLVED * rules.radius)
    wanted = float(np.median(np.clip(flat, least, COARSER * least)))
    side = longest_side(points)
    finest = side / max(SIDE, 1.25 * float(np.sqrt(len(points))))
    return min(max(wanted, finest), side / FEWEST)


def choose_levels(
    samples: NDArray[np.float64],
    spacing: NDArray[np.float64],
    rules: RuleBase,
    flat: NDArray[np.float64],
    sizes: tuple[float, float],
    n_threads: int,
) -> tuple[float, NDArray[np.int64]]:
    """Halve or double the cubes where the data is denser or sparser, or bent more or less.

    Where a clean part is thin they are halved once more, so that arms do not fall to pieces.

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
        Edge of a cube where data is as usual, and the longest that any may have.
    n_threads : int
        Number of threads.

    Returns
    -------
    finest : float
        Edge of the finest cubes.
    levels : (n,) int64
        The cubes around a sample have an edge of ``finest * 2**level``.
    """
    size, most = sizes
    nearest = KdTree(rules.centers, n_threads).query(samples, 1, np.inf, n_threads)[1][:, 0]
    # Wide rules are no reason for gaps.
    resolved = np.minimum(RESOLVED * rules.radius[nearest], size)
    least = np.maximum(SPACING * spacing, resolved)
    wanted = np.minimum(np.clip(flat[nearest], least, COARSER * least), most)
    steps = np.floor(np.log2(wanted / size) + 1.0 - DOWN).astype(np.int64)
    certain = rules.confidence[nearest]
    thin = (certain > 0.0) & (certain < THIN) & (SPACING * spacing >= resolved)
    steps = np.maximum(steps - thin, -FINER)
    finer = max(0, -int(steps.min()))
    return size / 2**finer, steps + finer
