"""Stage 2: points that lie on no surface (Algorithm 1, step 5)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, fit_scales
from o3d_sofnn.sampling.scales.choice import Limits, Scale, choose_scale

COMPANY = 8
"""Neighbours looked at."""


ALONE = (2.2, 2.5)
"""Mean distance to the neighbours from which on a point is alone, over the usual one of the region
and over that of the neighbours themselves."""


SPARSE = 2.0
"""Distance of neighbours, over that of the whole cloud, from which on pilots may be outliers. From
one place the spacing grows with the distance: where that is known, both are divided by it."""


FLAT = 0.05
"""Surface variation of neighbourhoods that lie on a surface."""


MANY = 0.01
"""Share of outliers above which the rest is looked at again: where some are far from the surface
others are near it. Without that, 10 % of outliers cost a clean mesh 1.3 times the Chamfer distance
(four shapes; 1.0 times at 0.5 % noise)."""


@dataclass(frozen=True)
class Samples:
    """Points that lie on the surface, or about it.

    Attributes
    ----------
    points : (m, 3) float64
        Distinct points without the outliers, in Morton order.
    tree : KdTree
        Over them.
    scale : Scale
        Of them.
    kept : (n,) bool
        Which of the distinct points of the cloud they are.
    sight : (m, 3) float64, optional
        Vectors of any length from them to where they were seen from, zero where unknown.
    """

    points: NDArray[np.float64]
    tree: KdTree
    scale: Scale
    kept: NDArray[np.bool_]
    sight: NDArray[np.float64] | None = None

    def parted(self, off: NDArray[np.bool_], n_threads: int) -> Samples:
        """Leave out some of the points, (m,) bool; the scale stays."""
        kept = self.kept.copy()
        kept[kept] = ~off
        points = np.ascontiguousarray(self.points[~off])
        sight = None if self.sight is None else self.sight[~off]
        return Samples(points, KdTree(points, n_threads), self.scale, kept, sight)

    def without(self, off: NDArray[np.bool_], limits: Limits, n_threads: int) -> Samples:
        """Leave out some of the points, (m,) bool, and find the scale of the others."""
        return self.parted(off, n_threads)._scaled(limits, n_threads)

    def seen(self, sight: NDArray[np.float64] | None, limits: Limits, n_threads: int) -> Samples:
        """Find the scale anew, knowing in which directions, (m, 3), the sensor stood, if any is."""
        return replace(self, sight=sight)._scaled(limits, n_threads)

    def _scaled(self, limits: Limits, n_threads: int) -> Samples:
        scale = choose_scale(self.points, self.tree, limits, n_threads, sight=self.sight)
        return replace(self, scale=scale)


def part_outliers(
    points: NDArray[np.float64],
    limits: Limits,
    n_threads: int,
    near: NDArray[np.bool_] | None = None,
    *,
    distance: NDArray[np.float64] | None = None,
) -> Samples:
    """Part the points from their outliers, and find the scale of what remains.

    Many outliers make each other's company, and the spacing of the surface hard to see: then the
    same is asked once more of what remains.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points in Morton order.
    limits, n_threads
        As in :func:`o3d_sofnn.sampling.scales.choice.choose_scale`.
    near : (n,) bool, optional
        False for points that are known as outliers.
    distance : (n,) float64, optional
        From where each point was seen.

    Returns
    -------
    Samples
    """
    kept = np.ones(len(points), bool) if near is None else near
    points = points if kept.all() else np.ascontiguousarray(points[kept])
    tree = KdTree(points, n_threads)
    samples = Samples(points, tree, choose_scale(points, tree, limits, n_threads), kept)
    for _ in range(2):
        far = None if distance is None else distance[samples.kept]
        off = find_outliers(samples.points, samples.tree, samples.scale, n_threads, distance=far)
        if off.any():
            samples = samples.without(off, limits, n_threads)
        if off.mean() < MANY:
            break
    return samples


def find_outliers(
    points: NDArray[np.float64],
    tree: KdTree,
    scale: Scale,
    n_threads: int,
    *,
    distance: NDArray[np.float64] | None = None,
) -> NDArray[np.bool_]:
    """Mark points that lie alone (Algorithm 1, step 5).

    The paper counts points in the cells around. With uneven density the same question is asked of
    the mean distance to the nearest points: against theirs (Breunig et al. 2000, local outlier
    factor), and against the spacing of the region, for outliers that have each other as neighbours;
    sparse parts of a surface are told from those by being flat.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points.
    tree : KdTree
        Over `points`.
    scale : Scale
        Of the same points.
    n_threads : int
        Threads.
    distance : (n,) float64, optional
        From where each point was seen.

    Returns
    -------
    (n,) bool
        True for outliers.
    """
    k = min(COMPANY + 1, len(points))
    if k < 5:
        return np.zeros(len(points), bool)
    usual = _usual_distance(points, tree, scale, k, distance, n_threads)
    # All neighbours within the limit: so is their mean. Only the few others are looked at closely.
    crowded = tree.crowded(points, k, ALONE[0] * usual, n_threads)
    doubtful = np.flatnonzero(crowded == 0)
    reach, index = _mean_distance(points[doubtful], tree, k, n_threads)
    alone = reach > ALONE[0] * usual[doubtful]
    lonely, reach, index = doubtful[alone], reach[alone], index[alone]
    if not 0 < len(lonely) < 0.5 * len(points):
        return np.zeros(len(points), bool)
    variation = fit_scales(tree, points, points[lonely], np.array([k + 4]), n_threads)[3]
    around, _ = _mean_distance(points[index.ravel()], tree, k, n_threads)
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
    n_threads: int,
) -> NDArray[np.float64]:
    """Distance of neighbours on the surface around each point, (n,).

    Where outliers are many, pilots are among them; those that stand neither close nor on a surface
    have no say, or outliers would be compared with outliers.
    """
    usual = scale.spacing + scale.noise
    expected = np.ones(len(usual))
    if distance is not None:
        expected = distance[tree.query(scale.places, 1, np.inf, n_threads)[1][:, 0]]
    credible = usual <= SPARSE * np.median(usual / np.maximum(expected, 1e-300)) * expected
    sparse = np.flatnonzero(~credible)
    if len(sparse):
        places = scale.places[sparse]
        variation = fit_scales(tree, points, places, np.array([k + 4]), n_threads)[3]
        credible[sparse] = variation[:, 0] < FLAT
    if credible.all():
        return np.asarray(usual[scale.at(points, n_threads)])
    places = scale.places[credible]
    near = KdTree(places, n_threads).query(points, 1, np.inf, n_threads)[1][:, 0]
    return np.asarray(usual[credible][near])


def _mean_distance(
    x: NDArray[np.float64], tree: KdTree, k: int, n_threads: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Mean distance of points of the tree to their neighbours, and these without the point."""
    distance, index = tree.query(x, k, np.inf, n_threads)
    return np.asarray(distance[:, 1:].mean(axis=1)), np.asarray(index[:, 1:])
