"""One point stands for several where the points are far closer together than their noise is wide.

A fit that averages noise has to be several times as wide as the noise. Where points are very dense,
the largest fits are narrower than that: their normals are random, and more points make it worse.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.sampling.normalization import Cloud
from o3d_sofnn.sampling.outliers import Samples
from o3d_sofnn.sampling.scales.choice import SCALES, Scale

DENSE = 2.0
"""Noise level, divided by the spacing, that thinning leaves: a fit to 1000 points is then nine
times as wide as the noise."""


FEWEST = 6
"""Number of points from which one of them stands for all: below it, the largest fits are wide
enough, and average more with all points. With 1.2 % noise on an icosahedron, one million points
have 8; their normals are off by 32.6 degrees without thinning, by 11.8 degrees with it."""


LONGEST = 20.0
"""Longest side of a cell, divided by the noise level: points far from all others stay as they are.
Ten would leave the outermost points of the noise single, eight times as many as there should be."""


REGION = 200
"""Number of pilots that decide together: where the density changes often, fits lean."""


TURN = (5.0**0.5 - 1.0) / 2.0
"""Step of the sequence that picks the points: of neighbouring cells it picks different corners."""


Array = NDArray[np.float64]


def thinned(cloud: Cloud, samples: Samples) -> Cloud:
    """Let one point stand for a cell of points where noise is much wider than the spacing.

    The cells come from halving the points again and again at their medians, so that they follow the
    density and what is left is spread like the points.

    Parameters
    ----------
    cloud : Cloud
        The cloud.
    samples : Samples
        Its inliers, with spacing and noise. Outliers stay as they are.

    Returns
    -------
    Cloud
        The same cloud if its points are not that dense; otherwise one with fewer distinct points.
    """
    scale = samples.scale
    count = _per_cell(scale)
    if count.max() < FEWEST:
        return cloud
    pilot = scale.at(samples.points)
    cell = _cells(samples.points, samples.tree, count[pilot], scale.noise[pilot])
    inliers = np.flatnonzero(samples.kept)
    stands = np.arange(len(cloud.points))
    stands[inliers] = inliers[cell]
    left, index = np.unique(stands, return_inverse=True)
    return replace(
        cloud,
        points=np.ascontiguousarray(cloud.points[left]),
        near=cloud.near[left],
        first=cloud.first[left],
        inverse=index[cloud.inverse],
    )


def _per_cell(scale: Scale) -> Array:
    """Return how many points a cell should hold at each pilot, (p,); 1 where fits suffice."""
    around = scale.tree.query(scale.places, min(REGION, len(scale.places)), np.inf)[1]
    count = np.median((scale.noise / (DENSE * scale.spacing))[around], axis=1) ** 2
    # Elsewhere it is the shape that asks for smaller fits.
    widest = (scale.n_neighbors >= SCALES[-3])[around].mean(axis=1) > 0.5
    return np.where(widest & (count >= FEWEST), count, 1.0)


def _cells(points: Array, tree: KdTree, count: Array, noise: Array) -> NDArray[np.int64]:
    """Return for each point the one that stands for it, (n,).

    Parameters
    ----------
    points : (n, 3) float64
        The points.
    tree : KdTree
        Tree of the points, which halves them.
    count : (n,) float64
        Number of points that a cell should hold around each point.
    noise : (n,) float64
        Noise level there.
    """
    n = len(points)
    order, level = np.asarray(tree.order()), tree.depth
    while n >> level > FEWEST:
        order, level = _halved(points, order, level), level + 1
    stands, wanted, most = np.arange(n), count[order], LONGEST * noise[order]
    for coarser in range(level, -1, -1):
        start = _branches(n, coarser)
        size = np.diff(np.append(start, n))
        joined = np.minimum.reduceat(wanted, start) >= size / np.sqrt(2.0)
        joined &= _sides(points[order], start).max(axis=1) <= np.minimum.reduceat(most, start)
        if not joined.any():
            break
        share = (np.arange(len(start)) + 1) * TURN % 1.0
        pick = order[start + (size * share).astype(np.int64)]
        member = np.repeat(joined, size)
        stands[order[member]] = np.repeat(pick, size)[member]
    return stands


def _branches(n: int, level: int) -> NDArray[np.int64]:
    """Return where the branches of a level of a tree of n points begin, (2**level,)."""
    return (np.arange(2**level, dtype=np.int64) * n) >> level


def _sides(x: Array, start: NDArray[np.int64]) -> Array:
    """Return the sides of the boxes of runs of points, (b, 3)."""
    return np.asarray(np.maximum.reduceat(x, start) - np.minimum.reduceat(x, start))


def _halved(points: Array, order: NDArray[np.int64], level: int) -> NDArray[np.int64]:
    """Sort each branch of a level along its longest side, so that its halves lie apart."""
    start = _branches(len(order), level)
    x = points[order]
    sides = _sides(x, start)
    branch = np.repeat(np.arange(len(start)), np.diff(np.append(start, len(order))))
    along = np.take_along_axis(x, sides.argmax(axis=1)[branch, None], axis=1)[:, 0]
    return order[np.lexsort((along, branch))]
