"""Edges of the cubes: what the user wants, or what spacing and noise support at each place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ._kernels import KdTree
from .rule_base import RuleBase
from .vectors import longest_side

SIDE = 1024
"""Cubes along the longest side that are never too many, however few points a wide scene has; an
object with n points has about sqrt(n) spacings along its side."""
THIN = 0.6
"""Confidence in the side below which a part is hardly thicker than the cubes, which are halved."""
FINER = 3
"""Levels that the densest places may be finer than the median."""


def choose_voxel_size(
    points: NDArray[np.float64],
    spacing: float,
    rules: RuleBase,
    depth: int | None,
    voxel_size: float | None,
) -> float:
    """Edge of a cube: what the user wants, or what spacing, noise and the number of points support.

    Parameters
    ----------
    points : (n, 3) float64
        The cloud.
    spacing : float
        Edge of the square that one point covers.
    rules : RuleBase
        Rules; a quarter of their radius resolves their quadrics.
    depth : int or None
        Octree depth over the longest side.
    voxel_size : float or None
        Edge of a cube.

    Returns
    -------
    float
        In the unit of the points.
    """
    if voxel_size is not None:
        return voxel_size
    if depth is not None:
        return float(longest_side(points) / 2**depth)
    wanted = max(0.75 * spacing, 0.15 * float(np.median(rules.radius)))
    finest = longest_side(points) / max(SIDE, 1.25 * float(np.sqrt(len(points))))
    return max(wanted, finest)


def choose_levels(
    samples: NDArray[np.float64],
    spacing: NDArray[np.float64],
    rules: RuleBase,
    size: float,
    n_threads: int,
) -> tuple[float, NDArray[np.int64]]:
    """Halve or double the cubes where the data is more than twice as dense or as sparse.

    Where a clean part is thin they are halved once more, so that arms do not fall to pieces.

    Parameters
    ----------
    samples : (n, 3) float64
        Points moved onto the surface.
    spacing : (n,) float64
        Edge of the square that one point covers, at each.
    rules : RuleBase
        Rules; a quarter of their radius resolves their quadrics.
    size : float
        Edge of a cube where data is as usual.
    n_threads : int
        Threads.

    Returns
    -------
    finest : float
        Edge of the finest cubes.
    levels : (n,) int64
        The cubes around a sample have an edge of ``finest * 2**level``.
    """
    nearest = KdTree(rules.centers, n_threads).query(samples, 1, np.inf, n_threads)[1][:, 0]
    resolved = np.minimum(0.15 * rules.radius[nearest], size)  # wide rules are no reason for gaps
    wanted = np.maximum(0.75 * spacing, resolved)
    steps = np.trunc(np.log2(wanted / size)).astype(np.int64)
    certain = rules.confidence[nearest]
    thin = (certain > 0.0) & (certain < THIN) & (0.75 * spacing >= resolved)
    steps = np.maximum(steps - thin, -FINER)
    finer = max(0, -int(steps.min()))
    return size / 2**finer, steps + finer
