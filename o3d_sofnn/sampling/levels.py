"""Levels that coordinates lie on, and whether they are there because somebody sampled on a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CROWDED = 2.5
"""Points for each level, at least: neighbourhoods of random coordinates have one."""


CLEAR = 0.01
"""Width of a level over the step, at most, the mean of all: rounding leaves none, arithmetic in
single precision after it a hundredth of a step where that is a ten-thousandth of the offset."""


BLUR = 1e-4
"""Gap up to which coordinates are on one level, over the range of 300 points on a surface: that is
some 20 spacings, and steps that matter are longer than a fifth of one."""


REGULAR = (0.6, 1.4, 0.7)
"""Gaps over their median that count as one step, and the share of such gaps: 0.9 on a sparse grid,
0.8 for steps of disparity in whole millimetres, 0.3 for random levels."""


COMPLETE = (0.05, 0.85)
"""Share of points that have their column of a grid to themselves, all but, and of neighbouring
columns that are taken: a surface that was sampled on a grid has one point in each."""


def find_levels(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Find the step between the levels of coordinates.

    Parameters
    ----------
    values : (p, k) float64
        A coordinate of the points of p neighbourhoods.

    Returns
    -------
    step : (p,) float64
        Median gap between levels; 0 where coordinates are on no levels or on irregular ones.
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
    """Tell complete grids of single points, a pattern of sampling, from rounded coordinates.

    Parameters
    ----------
    one, two : (p, k) float64
        Two coordinates of the points of p neighbourhoods, nearest first, over their steps.

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
