"""Evidence that distinguishes rounded coordinates from points that were sampled on a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, fit_quadrics
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.sampling.levels import BLUR, sampling_pattern

REACH, SMALLEST = 2.5, 27
"""Radius of the fits divided by the step, and their smallest number of points: they contain five
levels."""


ROUNDED = (0.5, 2.5)
"""Range of the residual of a fit, divided by the residual of rounding: less is a clean surface,
more is shape. Measured: 0.7 to 1.9 on rounded shapes, 0 to 0.3 on slices and rings."""


VOLUME = 0.25
"""Smallest surface variation of neighbourhoods that are not on a surface: it is 0.33 in a ball full
of points, and at most 0.22 in 9 of 10 neighbourhoods with five levels of rounded shapes."""


OBLIQUE = (0.3, 0.55)
"""Component of the normal along an axis above which the steps of that axis would show in the
residual, and above which a residual counts as evidence for them: there, noise in other directions
contributes less."""


SMOOTH = 0.25
"""Largest product of curvature and step of fits that count as such evidence: along the edges of a
cube sampled on a grid, residuals are as large as those of rounding, but the fits are more curved
(0.5)."""


COARSE = 1.7
"""Step divided by spacing above which fits with five levels are too wide to distinguish steps from
shape, and points are spread within the step. Below, a noise floor alone is more accurate (by 5 to
15 % at 1.5); above 3, the surface is lost without spreading (fertility, horse and fandisk rounded
along one axis)."""


GENTLE, BESIDE, ENOUGH = 0.7, 1.5, 6
"""Smallest component of the normal along an axis for which the points of one level are evidence;
their largest distance, divided by the largest step; and their smallest number. Bands are at least
as wide as the step."""


CROSSED = 0.9
"""Distance along an axis, divided by its step, above which a neighbourhood contains another
level."""


PATTERN = 50
"""Number of nearest points in which a sampling pattern is searched for."""


@dataclass(frozen=True)
class Fits:
    """Quadrics around pilots, wide enough to contain several levels.

    Attributes
    ----------
    normals : (p, 3) float64
        Unit normals of either sign.
    residual : (p,) float64
        Root-mean-square residuals.
    curvature : (p,) float64
        Largest absolute curvatures.
    variation : (p,) float64
        Surface variation: smallest eigenvalue of the covariance of the points, divided by the
        trace.
    crossed : (p, 3) bool
        Axes along which the points of a fit are on more than one level.
    """

    normals: NDArray[np.float64]
    residual: NDArray[np.float64]
    curvature: NDArray[np.float64]
    variation: NDArray[np.float64]
    crossed: NDArray[np.bool_]


def fit_across(
    points: NDArray[np.float64],
    tree: KdTree,
    step: NDArray[np.float64],
    distance: NDArray[np.float64],
    around: NDArray[np.float64],
) -> Fits:
    """Fit quadrics that contain five levels, or all levels of their neighbourhoods.

    Parameters
    ----------
    points : (n, 3) float64
        Points.
    tree : KdTree
        Tree of `points`.
    step : (p, 3) float64
        Steps of the levels, 0 for none.
    distance, around : (p, k) and (p, k, 3) float64
        Distances and coordinates of the points around each pilot, nearest first (the pilot itself).

    Returns
    -------
    Fits
    """
    places, k = np.ascontiguousarray(around[:, 0]), distance.shape[1]
    within = (distance <= REACH * step.max(axis=1, keepdims=True)).sum(axis=1)
    within = np.maximum(within, min(SMALLEST, k))
    zeros, ones = np.zeros(len(places)), np.ones(len(places))
    frames, c, residual, radius, _ = fit_quadrics(
        tree, points, places, within, zeros, 1, None, None, None, ones
    )
    tilt = c[:, 1:2] * frames[:, 0] + c[:, 2:3] * frames[:, 1]
    bend = np.abs(c[:, 3] + c[:, 5]) + np.hypot(c[:, 3] - c[:, 5], c[:, 4])
    offset = (around - places[:, None]) * (np.arange(k) < within[:, None])[:, :, None]
    mean = offset.sum(axis=1) / within[:, None]
    covariance = np.einsum("pki,pkj->pij", offset, offset) / within[:, None, None]
    variance = np.linalg.eigvalsh(covariance - mean[:, :, None] * mean[:, None])
    return Fits(
        normals=unit(frames[:, 2] - tilt),
        residual=np.asarray(residual),
        curvature=bend / np.maximum(radius, 1e-300),
        variation=variance[:, 0] / np.maximum(variance.sum(axis=1), 1e-300),
        crossed=(step > 0.0) & (np.abs(offset).max(axis=1) >= CROSSED * step),
    )


def evidence(
    step: NDArray[np.float64],
    spacing: NDArray[np.float64],
    around: NDArray[np.float64],
    fits: Fits,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Mark axes along which neighbourhoods show that they were rounded, or that they were not.

    Many show neither: the surface runs along one level, or a fit cannot follow its curvature.

    Parameters
    ----------
    step, spacing : (p, 3) and (p,) float64
        Steps of the levels, 0 for none, and edges of the squares that one point covers.
    around : (p, k, 3) float64
        Points of the neighbourhoods, nearest first.
    fits : Fits
        The result of :func:`fit_across`.

    Returns
    -------
    rounded, sampled : (p, 3) bool
    """
    rounded, sampled = _by_residual(step, fits)
    wide = fits.crossed & (step > COARSE * spacing[:, None])
    filled, lines = _by_level(step, wide, around, fits.normals)
    rounded, sampled = np.where(wide, filled, rounded), np.where(wide, lines, sampled)
    other = _patterns(step, around) | (fits.variation >= VOLUME)[:, None]
    return rounded & ~other, sampled | other


def _by_residual(
    step: NDArray[np.float64], fits: Fits
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Mark axes (p, 3) for which residuals are evidence of rounding, and of its absence.

    Rounded points deviate from the surface uniformly by up to half a step along each axis. Points
    of slices or rings lie on it, or deviate as much where the normal is perpendicular to the axis.
    """
    deviation = step / np.sqrt(12.0)
    expected = np.sqrt((fits.normals**2 * deviation**2).sum(axis=1))
    low, high = (factor * expected for factor in ROUNDED)
    some, most = ((step > 0.0) & (np.abs(fits.normals) >= least) for least in OBLIQUE)
    agrees = (fits.residual >= low) & (fits.residual <= high)
    plain = most.any(axis=1) & (fits.curvature * step.max(axis=1) <= SMOOTH)
    blind = ~some.any(axis=1) & (fits.residual >= ROUNDED[0] * deviation.max(axis=1))
    against = (some & fits.crossed & ~agrees[:, None]) | blind[:, None]
    return (step > 0.0) & (agrees & plain)[:, None], (step > 0.0) & against


def _by_level(
    step: NDArray[np.float64],
    asked: NDArray[np.bool_],
    around: NDArray[np.float64],
    normals: NDArray[np.float64],
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Mark axes (p, 3) on whose levels points fill bands, and those on which they form lines.

    From one level to the next, a surface moves sideways, and farther where it is less inclined. The
    points rounded to one level fill a band of that width. Slices and rings are lines on any slope.
    """
    filled, lines = np.zeros(step.shape, bool), np.zeros(step.shape, bool)
    reach = BESIDE * step.max(axis=1)
    for axis in range(3):
        up = np.minimum(np.abs(normals[:, axis]), 1.0 - 1e-9)
        rows = np.flatnonzero(asked[:, axis] & (up >= GENTLE))
        offset, up = around[rows] - around[rows, :1], up[rows]
        flat = np.delete(offset, axis, axis=2)
        near = np.abs(offset[:, :, axis]) <= 0.5 * step[rows, axis, None]
        near &= np.linalg.norm(flat, axis=2) <= reach[rows, None]
        count, flat = near.sum(axis=1), flat * near[:, :, None]
        mean = flat.sum(axis=1) / count[:, None]
        spread = np.einsum("pki,pkj->pij", flat, flat) / count[:, None, None]
        spread -= mean[:, :, None] * mean[:, None]
        width = np.sqrt(np.maximum(np.linalg.eigvalsh(spread)[:, 0], 0.0))
        band = step[rows, axis] * up / np.sqrt(12.0 * (1.0 - up**2))
        wide = width >= ROUNDED[0] * np.minimum(band, 0.5 * reach[rows])
        filled[rows, axis] = (count >= ENOUGH) & wide
        lines[rows, axis] = (count >= ENOUGH) & ~wide
    return filled, lines


def _patterns(step: NDArray[np.float64], around: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark axes (p, 3) along which the points form a complete grid, or across a flat grid."""
    found = np.zeros(step.shape, bool)
    level = np.ptp(around[:, :PATTERN], axis=1) <= BLUR * step.max(axis=1, keepdims=True)
    for one, two, third in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
        rows = np.flatnonzero((step[:, one] > 0.0) & (step[:, two] > 0.0))
        if len(rows):
            first = around[rows, :PATTERN, one] / step[rows, one, None]
            second = around[rows, :PATTERN, two] / step[rows, two, None]
            complete = rows[sampling_pattern(first, second)]
            found[complete, one] = found[complete, two] = True
            found[complete, third] |= level[complete, third]
    return found
