"""Stage 5: few places that represent the points where sides are decided, and their spacing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.sampling.cells import build_octree
from o3d_sofnn.sampling.normalization import RESOLUTION
from o3d_sofnn.threads import thread_count

Array = NDArray[np.float64]


CROWD, MOST = 3760.0, 64
"""A representative combines at most ``(n / CROWD) ** 0.9`` of n points, or is one of them; never
more than `MOST`, so that a part of a large cloud has no fewer than the same part alone."""


LAYER = 3.0
"""Noise divided by the spacing of the points above which they fill a thick layer. There, means of
octree cells would be up to eight times as dense in some places as in others, depending on whether a
cell was divided."""


BESIDE, FLAT = 8, 0.35
"""Number of cells in a neighbourhood, and standard deviation of its points from their plane,
divided by the one along it, above which it is no part of a surface but holds two sheets, or an arm
seen as a line. An edge is one, too, but only few cells are beside an edge."""


ASKED = 4
"""Only at every so many-th cell is it asked whether the neighbourhood is flat."""


REGION, SAMPLED, LOST, STILL = 16, 4, 0.9, 0.5
"""Number of cells that were asked in a region, at every so many-th of them; share of neighbourhoods
that are not flat above which a region is divided; the same once it has been divided. The shapes of
the benchmarks reach 0.9 at the tips of thin arms only, plates with 26 cells each everywhere."""


DIVISION = 4
"""Factor between the capacities of cells before and after: half the spacing on a surface."""


LOCAL = 16
"""Number of representatives whose median gives the local spacing."""


def representatives(points: Array, noise: float, spacing: float) -> tuple[Array, NDArray[np.int64]]:
    """Combine neighbouring points into representatives, or choose some from a thick layer.

    The cells that are combined are divided again where the parts they should distinguish are no
    larger than themselves: thin plates and arms, however many of them there are.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points in Morton order.
    noise : float
        Standard deviation of the points from the surface.
    spacing : float
        Edge of the square that one point covers.

    Returns
    -------
    places : (m, 3) float64
        Means of octree leaves, or chosen points, in Morton order: about half of 20,000 points, and
        a fortieth of a million.
    stands : (n,) int64
        Representative of each point: the one of its leaf, or one close in Morton order.
    """
    n = len(points)
    capacity = int((n / CROWD) ** 0.9)
    if capacity < 2:
        return points, np.arange(n)
    if noise / spacing > LAYER:
        some = len(build_octree(points, capacity).size)
        rows = np.linspace(0, n - 1, some).astype(np.int64)
        return points[rows], np.searchsorted(rows, np.arange(n))
    capacity = min(capacity, MOST)
    cells = build_octree(points, capacity)
    offsets, asked, share = cells.offsets, np.ones(len(cells.size), bool), LOST
    while capacity > 1:
        divided = asked & _unresolved(cells.points, offsets, noise, share)
        if not divided.any():
            break
        capacity, share = capacity // DIVISION, STILL
        finer = build_octree(points, max(capacity, 1)).offsets
        inner = finer[divided[np.searchsorted(offsets, finer[:-1], side="right") - 1].nonzero()]
        whole, offsets = offsets, np.union1d(offsets, inner)
        asked = divided[np.searchsorted(whole, offsets[:-1], side="right") - 1]
    count = np.diff(offsets)
    stands = np.empty(n, np.int64)
    stands[cells.order] = np.repeat(np.arange(len(count)), count)
    return _means(cells.points, offsets), stands


def _means(x: Array, offsets: NDArray[np.int64]) -> Array:
    """Return the means, (c, d), of the rows of each cell."""
    return np.asarray(np.add.reduceat(x, offsets[:-1]) / np.diff(offsets)[:, None])


def _unresolved(
    points: Array, offsets: NDArray[np.int64], noise: float, share: float
) -> NDArray[np.bool_]:
    """Mark cells, (c,), of regions where more than a share of the neighbourhoods is not flat."""
    x = _means(points, offsets)
    a, b = np.triu_indices(3)
    square = np.concatenate(
        [
            _means(points[:, i, None] * points[:, j, None], offsets)
            for i, j in zip(a, b, strict=True)
        ],
        axis=1,
    )
    asked = np.ascontiguousarray(x[::ASKED])
    near = KdTree(x, thread_count()).query(asked, min(BESIDE, len(x)), np.inf)[1]
    middle = x[near].mean(axis=1)
    scatter = np.empty((len(asked), 3, 3))
    scatter[:, a, b] = square[near].mean(axis=1) - middle[:, a] * middle[:, b]
    scatter[:, b, a] = scatter[:, a, b]
    across, along = np.linalg.eigvalsh(scatter)[:, :2].T
    bent = (across - noise**2 > FLAT**2 * along) & (along > noise**2)
    places = np.ascontiguousarray(asked[::SAMPLED])
    region = KdTree(asked, thread_count()).query(places, min(REGION, len(asked)), np.inf)[1]
    lost = bent[region].mean(axis=1) > share
    if not lost.any():
        return np.zeros(len(x), bool)
    return np.asarray(lost[KdTree(places, thread_count()).query(x, 1, np.inf)[1][:, 0]])


def local_spacing(x: Array, tree: KdTree) -> Array:
    """Find the spacing of samples around each of them.

    Parameters
    ----------
    x : (m, 3) float64
        Samples.
    tree : KdTree
        Tree of `x`.

    Returns
    -------
    (m,) float64
        Local median of the median distance to the four nearest samples.
    """
    distance, index = tree.query(x, min(LOCAL, len(x)), np.inf)
    near = np.median(distance[:, 1:5], axis=1)
    return np.asarray(np.maximum(np.median(near[index], axis=1), RESOLUTION))
