"""Stage 2: points that lie on no surface (Algorithm 1, step 5)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, fit_scales
from o3d_sofnn.sampling.scales.choice import Limits, Scale, choose_scale
from o3d_sofnn.threads import thread_count

COMPANY = 8
"""Number of neighbours that are examined."""


ALONE = (2.2, 2.5)
"""A point is isolated if its mean distance to its neighbours exceeds these factors times the
typical distance in the region and times the neighbours' own mean distance."""


SPARSE = 2.0
"""Spacing, divided by the spacing of the whole cloud, above which pilots may be outliers. Seen from
one place, the spacing grows with the distance; if the distances are known, both are divided by
them."""


FLAT = 0.05
"""Largest surface variation of neighbourhoods that lie on a surface."""


MANY = 0.01
"""Share of outliers above which the remaining points are examined again: if many are far from the
surface, others are near it. Without that, 10 % of outliers cost a clean mesh 1.3 times the Chamfer
distance (four shapes; 1.0 times at 0.5 % noise)."""


@dataclass(frozen=True)
class Samples:
    """Points that lie on the surface or scatter around it.

    Attributes
    ----------
    points : (m, 3) float64
        Distinct points without the outliers, in Morton order.
    tree : KdTree
        Tree of these points.
    scale : Scale
        Scale of these points.
    kept : (n,) bool
        Mask of these points among the distinct points of the cloud.
    sight : (m, 3) float64, optional
        Vectors of any length from the points to where they were seen from, zero where unknown.
    """

    points: NDArray[np.float64]
    tree: KdTree
    scale: Scale
    kept: NDArray[np.bool_]
    sight: NDArray[np.float64] | None = None

    def parted(self, off: NDArray[np.bool_]) -> Samples:
        """Leave out the points in a mask, (m,) bool; keep the scale."""
        kept = self.kept.copy()
        kept[kept] = ~off
        points = np.ascontiguousarray(self.points[~off])
        sight = None if self.sight is None else self.sight[~off]
        return Samples(points, KdTree(points, thread_count()), self.scale, kept, sight)

    def without(self, off: NDArray[np.bool_], limits: Limits) -> Samples:
        """Leave out the points in a mask, (m,) bool, and find the scale of the others."""
        return self.parted(off)._scaled(limits)

    def seen(self, sight: NDArray[np.float64] | None, limits: Limits) -> Samples:
        """Find the scale again, using the directions to the sensor, (m, 3), if they are known."""
        return replace(self, sight=sight)._scaled(limits)

    def _scaled(self, limits: Limits) -> Samples:
        scale = choose_scale(self.points, self.tree, limits, sight=self.sight)
        return replace(self, scale=scale)


def part_outliers(
    points: NDArray[np.float64],
    limits: Limits,
    near: NDArray[np.bool_] | None = None,
    *,
    distance: NDArray[np.float64] | None = None,
) -> Samples:
    """Separate the points from their outliers, and find the scale of the inliers.

    Many outliers have each other as neighbours and hide the spacing of the surface. In that case
    the search is repeated with the remaining points.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points in Morton order.
    limits
        As in :func:`o3d_sofnn.sampling.scales.choice.choose_scale`.
    near : (n,) bool, optional
        False for points that are known to be outliers.
    distance : (n,) float64, optional
        Distance of each point from where it was seen.

    Returns
    -------
    Samples
    """
    kept = np.ones(len(points), bool) if near is None else near
    points = points if kept.all() else np.ascontiguousarray(points[kept])
    tree = KdTree(points, thread_count())
    samples = Samples(points, tree, choose_scale(points, tree, limits), kept)
    for _ in range(2):
        far = None if distance is None else distance[samples.kept]
        off = find_outliers(samples.points, samples.tree, samples.scale, distance=far)
        if off.any():
            samples = samples.without(off, limits)
        if off.mean() < MANY:
            break
    return samples


def find_outliers(
    points: NDArray[np.float64],
    tree: KdTree,
    scale: Scale,
    *,
    distance: NDArray[np.float64] | None = None,
) -> NDArray[np.bool_]:
    """Mark isolated points (Algorithm 1, step 5).

    The paper counts the points in the surrounding cells. For uneven density, we compare the mean
    distance to the nearest neighbours with their own (Breunig et al. 2000, local outlier factor),
    and with the spacing of the region, since outliers may have each other as neighbours. Sparse
    parts of a surface differ from such outliers by being flat.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points.
    tree : KdTree
        Tree of `points`.
    scale : Scale
        Scale of the same points.
    distance : (n,) float64, optional
        Distance of each point from where it was seen.

    Returns
    -------
    (n,) bool
        True for outliers.
    """
    k = min(COMPANY + 1, len(points))
    if k < 5:
        return np.zeros(len(points), bool)
    usual = _usual_distance(points, tree, scale, k, distance)
    # If all neighbours are within the limit, so is their mean. Only the few others are examined.
    crowded = tree.crowded(points, k, ALONE[0] * usual)
    doubtful = np.flatnonzero(crowded == 0)
    reach, index = _mean_distance(points[doubtful], tree, k)
    alone = reach > ALONE[0] * usual[doubtful]
    lonely, reach, index = doubtful[alone], reach[alone], index[alone]
    if not 0 < len(lonely) < 0.5 * len(points):
        return np.zeros(len(points), bool)
    variation = fit_scales(tree, points, points[lonely], np.array([k + 4]))[3]
    around, _ = _mean_distance(points[index.ravel()], tree, k)
    apart = reach > ALONE[1] * np.median(around.reshape(index.shape), axis=1)
    outlier = np.zeros(len(points), bool)
    outlier[lonely] = apart | (variation[:, 0] > FLAT)
    return outlier


def _usual_distance(
    points: NDArray[np.float64],
    tree: KdTree,
    scale: Scale,
    k: int,
    distance: NDArray[np.float64] | None,
) -> NDArray[np.float64]:
    """Return the typical distance between neighbours on the surface around each point, (n,).

    If there are many outliers, some pilots are outliers. Pilots that are neither close to others
    nor on a surface are ignored, so that outliers are not compared with outliers.
    """
    usual = scale.spacing + scale.noise
    expected = np.ones(len(usual))
    if distance is not None:
        expected = distance[tree.query(scale.places, 1, np.inf)[1][:, 0]]
    credible = usual <= SPARSE * np.median(usual / np.maximum(expected, 1e-300)) * expected
    sparse = np.flatnonzero(~credible)
    if len(sparse):
        places = scale.places[sparse]
        variation = fit_scales(tree, points, places, np.array([k + 4]))[3]
        credible[sparse] = variation[:, 0] < FLAT
    if credible.all():
        return np.asarray(usual[scale.at(points)])
    places = scale.places[credible]
    near = KdTree(places, thread_count()).query(points, 1, np.inf)[1][:, 0]
    return np.asarray(usual[credible][near])


def _mean_distance(
    x: NDArray[np.float64], tree: KdTree, k: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the mean distance of tree points to their neighbours, and the neighbours' indices."""
    distance, index = tree.query(x, k, np.inf)
    return np.asarray(distance[:, 1:].mean(axis=1)), np.asarray(index[:, 1:])
