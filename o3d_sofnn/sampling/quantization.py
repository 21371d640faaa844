"""Stage 1: rounded coordinates, and what rounding adds to the noise.

Rounded coordinates (LAS steps, text with few digits, voxel filters, disparity steps) have an error
that is uniform within a known width. Fits to points on one level mistake the level for the surface
and find no noise; if the step is longer than the spacing, the surface falls apart into layers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.sampling.levels import BLUR, REGULAR, find_levels
from o3d_sofnn.sampling.normalization import Cloud
from o3d_sofnn.sampling.outliers import Samples
from o3d_sofnn.sampling.rounding import COARSE, evidence, fit_across
from o3d_sofnn.sampling.scales.choice import PILOTS, REGION
from o3d_sofnn.threads import thread_count

AROUND, FEWEST = 300, 100
"""Number of points around a pilot that are examined, and size of the smallest cloud examined."""


FINE = 0.2
"""Steps below this, divided by the spacing, are ignored: their noise is below 0.06 spacings."""


APART = 40
"""Smallest number of points per pilot, so that regions are many points wide."""


VOTES = (4, 1.5)
"""Smallest number of pilots of a region with evidence for rounding, and its smallest ratio to the
number with evidence against it."""


SOLID = 0.25
"""Share of the pilots with steps along an axis whose regions must agree before the step is extended
to others, unless the evidence of all pilots together is as clear as in a region."""


GROWING = 0.2
"""Scatter of the logarithm of steps divided by squared distances, below which steps are considered
to grow with the squared distance."""


RECURRENCE = 1.2207440846057596 ** -np.arange(1.0, 4.0)
"""Additive recurrence of the offsets within a cell: uniform in one, two and three dimensions
(Roberts 2018, The unreasonable effectiveness of quasirandom sequences)."""


@dataclass(frozen=True)
class Steps:
    """Widths of the cells that coordinates were rounded to, known at a few pilot points.

    Attributes
    ----------
    tree : KdTree or None
        Tree of the pilots; None if no coordinate was rounded.
    width : (p, 3) float64
        Step along each axis, 0 for none, in the unit of the points.
    coarse : (p, 3) bool
        Axes along which points are spread within their cells.
    normals : (p, 3) float64
        Surface normals at the pilots.
    """

    tree: KdTree | None
    width: NDArray[np.float64]
    coarse: NDArray[np.bool_]
    normals: NDArray[np.float64]

    def spread(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Spread points (n, 3), in Morton order, evenly within the cells they were rounded to.

        No point moves by more than half a step along an axis.
        """
        if self.tree is None or not self.coarse.any():
            return points
        at = _nearest(self.tree, points)
        width = np.where(self.coarse, self.width, 0.0)[at]
        share = (np.arange(1, len(points) + 1)[:, None] * RECURRENCE) % 1.0 - 0.5
        return np.ascontiguousarray(points + share * width)

    def floored(self, samples: Samples) -> Samples:
        """Raise the noise in the scale of samples to at least the noise of the rounding."""
        if self.tree is None:
            return samples
        scale = samples.scale
        floor = self._deviation(self.width)[_nearest(self.tree, scale.places)]
        return replace(samples, scale=replace(scale, noise=np.maximum(scale.noise, floor)))

    def given(self, noise: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the noise (n,) of the given points, from the noise after :meth:`spread`."""
        if self.tree is None:
            return noise
        at = _nearest(self.tree, points)
        added = self._deviation(np.where(self.coarse, self.width, 0.0))[at]
        before = np.sqrt(np.maximum(noise**2 - added**2, 0.0))
        return np.asarray(np.maximum(before, self._deviation(self.width)[at]))

    def _deviation(self, width: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the deviation (p,) along the normals of errors that are uniform within widths."""
        return np.asarray(np.sqrt((self.normals**2 * width**2).sum(axis=1) / 12.0))


def spread_rounded(cloud: Cloud) -> tuple[Cloud, Steps]:
    """Find the steps to which a cloud was rounded, and spread its points where steps are long."""
    points = cloud.points if cloud.near.all() else np.ascontiguousarray(cloud.points[cloud.near])
    steps = find_steps(points, -cloud.middle / cloud.extent)
    if not steps.coarse.any():
        return cloud, steps
    long = (
        f"{axis}: {cloud.extent * np.median(steps.width[coarse, i]):.3g}"
        for i, (axis, coarse) in enumerate(zip("xyz", steps.coarse.T, strict=True))
        if coarse.any()
    )
    told = (
        f"coordinates were rounded to steps longer than the spacing ({', '.join(long)}): points "
        "were spread evenly within them"
    )
    spread = steps.spread(cloud.points)
    return replace(cloud, points=spread, warnings=(*cloud.warnings, told)), steps


def find_steps(points: NDArray[np.float64], origin: NDArray[np.float64]) -> Steps:
    """Find where coordinates were rounded, and to which steps.

    Coordinates that lie on a few regular levels were either rounded to them, or the surface was
    sampled there: on a grid, in slices, in rings. A region has a step if more of its neighbourhoods
    show evidence for rounding (:func:`rounding.evidence`); other regions have none.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points in Morton order.
    origin : (3,) float64
        Position of a depth camera if its coordinates are those of the points.

    Returns
    -------
    Steps
        Without a tree if no coordinate was rounded to a step of at least `FINE` times the spacing.
    """
    n, k = len(points), min(AROUND, len(points))
    none = Steps(None, np.zeros((0, 3)), np.zeros((0, 3), bool), np.zeros((0, 3)))
    if n < FEWEST:
        return none
    pilots = np.linspace(0, n - 1, min(-(-n // APART), PILOTS)).astype(np.int64)
    start = np.clip(pilots - k // 2, 0, n - k)
    if not _steps(points[start[:, None] + np.arange(k)]).any():  # most clouds: without a tree
        return none
    tree, places = KdTree(points, thread_count()), points[pilots]
    distance, near = tree.query(places, k, np.inf)
    around = points[near]
    spacing = distance[:, -1] * np.sqrt(np.pi / k)
    step = _steps(around)
    step[step < FINE * spacing[:, None]] = 0.0
    if not step.any():
        return none
    fits = fit_across(points, tree, step, distance, around)
    rounded, sampled = evidence(step, spacing, around, fits)
    pilot_tree = KdTree(places, thread_count())
    region = pilot_tree.query(places, min(REGION, len(places)), np.inf)[1]
    width = _agreed(step, rounded, sampled, region)
    if not width.any():
        return none
    level = np.ptp(around, axis=1) <= BLUR * spacing[:, None]
    agreed = ((width > 0.0) & (step > 0.0)).sum(axis=0)
    solid = agreed >= SOLID * (step > 0.0).sum(axis=0)
    solid |= rounded.sum(axis=0) >= VOTES[1] * sampled.sum(axis=0)
    for axis in np.flatnonzero(solid & (agreed > 0)):
        distance = np.abs(places[:, axis] - origin[axis])
        width[:, axis] = _continued(width[:, axis], step[:, axis], level[:, axis], distance)
    return Steps(pilot_tree, width, width > COARSE * spacing[:, None], fits.normals)


def _steps(around: NDArray[np.float64]) -> NDArray[np.float64]:
    """Find the steps (p, 3) of coordinates in neighbourhoods (p, k, 3), 0 where there are none.

    A single gap counts as a step if another axis has the same step.
    """
    found = [find_levels(around[:, :, axis]) for axis in range(3)]
    step = np.stack([one for one, _ in found], axis=1)
    several = np.stack([count > 2 for _, count in found], axis=1)
    sure = np.where(several, step, 0.0).max(axis=1, keepdims=True)
    return np.where(several | _alike(step, sure), step, 0.0)


def _agreed(
    step: NDArray[np.float64],
    rounded: NDArray[np.bool_],
    sampled: NDArray[np.bool_],
    region: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Choose the steps (p, 3) of regions in which the evidence for rounding prevails."""
    votes = rounded[region].sum(axis=1)
    won = (votes >= VOTES[0]) & (votes >= VOTES[1] * sampled[region].sum(axis=1))
    won &= won[region].mean(axis=1) >= 0.5
    falling = -np.sort(-np.where(rounded, step, 0.0)[region], axis=1)
    median = np.take_along_axis(falling, votes[:, None] // 2, axis=1)[:, 0]
    return np.where(won, np.where(_alike(step, median), step, median), 0.0)


def _continued(
    width: NDArray[np.float64],
    step: NDArray[np.float64],
    level: NDArray[np.bool_],
    distance: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Extend the agreed steps (p,) of an axis to other pilots: a file has one number format.

    These are pilots whose points all lie on one `level`, where steps cannot be seen, and pilots
    with the same steps but no evidence. If steps grow with the squared distance from the camera, as
    disparity steps do, "the same" means the same growth.
    """
    known = (width > 0.0) & (step > 0.0)
    even, square = step[known], step[known] / np.maximum(distance[known], 1e-12) ** 2
    grows = _scatter(square) < min(0.5 * _scatter(even), GROWING)
    usual = np.median(square) * distance**2 if grows else np.full(len(step), np.median(even))
    more = (width == 0.0) & (level | _alike(step, usual))
    return np.where(more, np.where(step > 0.0, step, usual), width)


def _alike(step: NDArray[np.float64], usual: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark steps that may equal the typical ones; 0 never does."""
    return (step >= REGULAR[0] * usual) & (step <= REGULAR[1] * usual) & (step > 0.0)


def _scatter(values: NDArray[np.float64]) -> float:
    """Return half of the interquartile range of the logarithms of positive values."""
    low, high = np.quantile(np.log(values), [0.25, 0.75])
    return float(0.5 * (high - low))


def _nearest(tree: KdTree, x: NDArray[np.float64]) -> NDArray[np.int64]:
    return np.asarray(tree.query(x, 1, np.inf)[1][:, 0])
