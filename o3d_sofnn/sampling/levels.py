"""Levels that coordinates lie on, and whether they come from sampling on a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CROWDED = 2.5
"""Smallest number of points per level: neighbourhoods of random coordinates have one."""


CLEAR = 0.01
"""Largest mean width of the levels, divided by the step. Rounding alone leaves no width; later
arithmetic in single precision leaves 0.01 if the step is a ten-thousandth of the offset."""


BLUR = 1e-4
"""Largest gap within one level, divided by the range of 300 points on a surface: that range is
about 20 times the spacing, and steps that matter are longer than a fifth of the spacing."""


REGULAR = (0.6, 1.4, 0.7)
"""Smallest and largest gap, divided by the median gap, that count as one step, and the smallest
share of such gaps. The share is 0.9 on a sparse grid, 0.8 for disparity steps in whole
millimetres, and 0.3 for random levels."""


COMPLETE = (0.05, 0.85)
"""Largest share of points that share their column of a grid with another point, and smallest share
of neighbouring columns that are occupied: a surface sampled on a grid has one point in each."""


def find_levels(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Find the step between the levels of coordinates.

    Parameters
    ----------
    values : (p, k) float64
        One coordinate of the points in p neighbourhoods.

    Returns
    -------
    step : (p,) float64
        Median gap between levels; 0 where coordinates do not lie on regular levels.
    count : (p,) int64
        Number of levels.
    """
    gaps = np.diff(np.sort(values, axis=1), axis=1)
    falling = -np.sort(-gaps, axis=1)
    most = min(int(values.shape[1] / CROWDED), gaps.shape[1] - 1)
    within = np.maximum(falling[:, most] / CLEAR, BLUR * gaps.sum(axis=1))
    between = gaps > within[:, None]
    steps = between.sum(axis=1)
    step = falling[np.arange(len(gaps)), steps // 2] * (steps > 0)
    low, high, share = REGULAR
    single = between & (gaps >= low * step[:, None]) & (gaps <= high * step[:, None])
    regular = single.sum(axis=1) >= share * steps
    width = np.where(between, 0.0, gaps).sum(axis=1) / (steps + 1)
    return np.where(regular & (width <= CLEAR * step), step, 0.0), steps + 1


def sampling_pattern(one: NDArray[np.float64], two: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Distinguish complete grids of single points (a sampling pattern) from rounded coordinates.

    Parameters
    ----------
    one, two : (p, k) float64
        Two coordinates of the points in p neighbourhoods, nearest first, divided by their steps.

    Returns
    -------
    (p,) bool
        True where every column of the grid holds one point.
    """
    rows = np.arange(len(one))[:, None]
    i = np.rint(one - one.min(axis=1, keepdims=True)).astype(np.int64) + 1
    j = np.rint(two - two.min(axis=1, keepdims=True)).astype(np.int64) + 1
    width = int(max(i.max(), j.max())) + 2
    key = (rows * width + i) * width + j
    ordered = np.sort(key, axis=1)
    repeated = (ordered[:, 1:] == ordered[:, :-1]).mean(axis=1)
    taken = np.unique(ordered)
    own = key[:, : key.shape[1] // 8]
    around = np.stack([own - 1, own + 1, own - width, own + width])
    filled = np.isin(around, taken).mean(axis=(0, 2))
    return np.asarray((repeated <= COMPLETE[0]) & (filled >= COMPLETE[1]))
