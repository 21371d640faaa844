"""Two sheets close to each other, which are not one noisy sheet."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.threads import thread_count

Array = NDArray[np.float64]


AROUND = 45
"""Number of points around a place: with a gap of two spacings, 16 are on the other sheet."""


APART = 0.2
"""Share of the variance of the heights that is left within two layers, below which there are two of
them: 0.36 for one sheet with Gaussian noise, 0.25 if noise fills the neighbourhood evenly. Of two
sheets, 0.2 is left if the gap is four times the noise of each."""


FEW = 0.15
"""Smallest share of the points on either layer: fewer are outliers."""


SEEN = 0.1
"""Noise divided by spacing above which two sheets may have been taken for it."""


ASKED, REGION = 400, 9
"""Largest number of pilots that are looked at; number of those in a region."""


def within_layers(
    points: Array, tree: KdTree, pilots: Array, noise: Array, spacing: Array
) -> Array:
    """Replace noise that is the distance of two sheets by the noise of each.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points.
    tree : KdTree
        Tree of `points`.
    pilots : (p, 3) float64
        Where the noise was measured.
    noise, spacing : (p,) float64
        Standard deviation of the points from one sheet, and edge of the square of one point.

    Returns
    -------
    (p,) float64
        The smaller noise of the nearest region with two layers, elsewhere `noise`.
    """
    rows = np.flatnonzero(noise > SEEN * spacing)
    rows = rows[:: -(-len(rows) // ASKED) or 1]
    if not len(rows) or len(points) < AROUND:
        return noise
    places = np.ascontiguousarray(pilots[rows])
    left, within = layered(points, tree, places)
    lookup = KdTree(places, thread_count())
    region = lookup.query(places, min(REGION, len(places)), np.inf)[1]
    two = np.median(left[region], axis=1) < APART
    least = np.where(two, np.median(within[region], axis=1), np.inf)
    nearest = lookup.query(pilots, 1, np.inf)[1][:, 0]
    return np.asarray(np.minimum(noise, least[nearest]))


def layered(points: Array, tree: KdTree, places: Array) -> tuple[Array, Array]:
    """Divide the points around places into two layers that are as thin as possible.

    Heights above a common quadric are split where the variance within the two parts is smallest
    (Otsu 1979); then two parallel quadrics are fitted.

    Parameters
    ----------
    points : (n, 3) float64
        At least 45 distinct points.
    tree : KdTree
        Tree of `points`.
    places : (p, 3) float64
        Where to look.

    Returns
    -------
    left : (p,) float64
        Share of the variance of the heights that is left within the layers.
    within : (p,) float64
        Standard deviation of the heights within the layers.
    """
    near = points[tree.query(places, AROUND, np.inf)[1]]
    offset = near - near.mean(axis=1, keepdims=True)
    axes = np.linalg.eigh(np.einsum("pka,pkb->pab", offset, offset))[1]
    height, u, v = np.moveaxis(np.einsum("pka,pab->pkb", offset, axes), 2, 0)
    size = np.maximum(np.sqrt((u**2 + v**2).mean(axis=1, keepdims=True)), np.finfo(float).tiny)
    u, v = u / size, v / size
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=2)
    rest = _misfit(terms, height)
    cut = _cut(np.sort(rest, axis=1))
    upper = (rest > cut[:, None]).astype(float)
    apart = _misfit(np.concatenate([terms, upper[:, :, None]], axis=2), height)
    whole, within = (rest**2).mean(axis=1), (apart**2).mean(axis=1)
    share = upper.mean(axis=1)
    low = (rest * (1.0 - upper)).sum(axis=1) / np.maximum((1.0 - upper).sum(axis=1), 1.0)
    high = (rest * upper).sum(axis=1) / np.maximum(upper.sum(axis=1), 1.0)
    between = share * (1.0 - share) * (high - low) ** 2
    left = 1.0 - between / np.maximum(whole, np.finfo(float).tiny)
    return left, np.sqrt(within)


def _misfit(terms: Array, height: Array) -> Array:
    """Return what is left of heights, (p, k), after a fit of terms, (p, k, t)."""
    size = terms.shape[2]
    square = np.einsum("pka,pkb->pab", terms, terms) + 1e-9 * terms.shape[1] * np.eye(size)
    right = np.einsum("pka,pk->pa", terms, height)
    fit = np.linalg.solve(square, right[:, :, None])[:, :, 0]
    return np.asarray(height - np.einsum("pka,pa->pk", terms, fit))


def _cut(heights: Array) -> Array:
    """Return the highest point of the lower part, (p,), of sorted heights, (p, k)."""
    count = heights.shape[1]
    below = np.arange(1, count)
    total = np.cumsum(heights, axis=1)
    first, rest = total[:, :-1], total[:, -1:] - total[:, :-1]
    between = first**2 / below + rest**2 / (count - below)
    usual = np.minimum(below, count - below) >= FEW * count
    best = np.where(usual, between, -np.inf).argmax(axis=1)
    return np.asarray(heights[np.arange(len(heights)), best])
