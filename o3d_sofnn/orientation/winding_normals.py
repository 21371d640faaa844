"""Stage 5: area-weighted normals whose winding number is one half at the samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, WindingLists, WindingTree
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.sampling.cells import build_octree
from o3d_sofnn.sampling.normalization import RESOLUTION
from o3d_sofnn.threads import thread_count

Array = NDArray[np.float64]


OPENING = 0.6
"""Opening angle of the tree code: a node is replaced by its moments if it appears smaller. With
first-order moments, 0.6 is as accurate as 0.3 with order zero, at half the cost."""


ROUNDS, STEPS, SOLVED = 2, 10, 0.01
"""Rounds of conjugate gradients, steps in each, and fraction of the first gradient at which a round
ends early: nested shells and walls around many cavities need that many. Many more would fit the
noise; between the rounds, the directions forget the noise they have fitted."""


SETTLED, MOST = 5e-4, 40
"""Share of samples changing sides below which the iteration at the coarse width ends, and largest
number of iterations."""


NARROWING = 5
"""Number of iterations from the coarse to the fine width."""


def winding_number_normals(x: Array, areas: Array, coarse: Array, fine: Array) -> Array:
    """Find normals whose winding number is one half on the surface and whose gradient they are.

    This combines two published methods. Lin et al., "Surface reconstruction from point clouds
    without normals by parametrizing the Gauss formula" (2022), solve ``A mu = 1/2`` by conjugate
    gradients, which finds the sides of nested surfaces. Lin, Shi and Liu, "Fast and globally
    consistent normal orientation based on the winding number normal consistency" (2024), alternate
    gradient steps with ``mu <- |mu| * unit(-grad(winding number of mu))``, which removes the noise
    from the directions but alone may end with inner surfaces flipped and shrunk. When the sides
    have settled, known areas replace the lengths, which have fitted the noise by then.

    Parameters
    ----------
    x : (m, 3) float64
        Positions on the surface or scattered around it.
    areas : (m,) float64
        Area of the surface around each position, in any unit.
    coarse, fine : (m,) float64
        Smoothing width at each position until the sides have settled, and at the end, in the unit
        of the points.

    Returns
    -------
    (m, 3) float64
        Area-weighted outward normals.
    """
    order = np.asarray(WindingTree(x, np.ones(len(x))).order())
    sorted_x, coarse, fine = np.ascontiguousarray(x[order]), coarse[order], fine[order]
    tree = WindingTree(sorted_x, np.ones(len(x)))
    samples = _Samples(tree, tree.lists(sorted_x, OPENING))
    half = np.full(len(x), 0.5)
    solved = SOLVED**2 * float((samples.descent(half, coarse) ** 2).sum())
    mu = np.zeros_like(sorted_x)
    for iteration in range(MOST):
        steps = STEPS if iteration < ROUNDS else 1
        before, mu = mu, samples.descend(mu, coarse, steps, solved)
        changed = (np.einsum("nd,nd->n", before, mu) < 0.0).mean()
        if iteration >= ROUNDS and changed < SETTLED:
            break
    mu = unit(mu) * areas[order, None]
    winding = samples.winding(mu, coarse)
    square = float((winding**2).sum())
    if square > 0.0:  # zero everywhere for points on a line
        mu *= 0.5 * winding.sum() / square
    for width in np.geomspace(coarse, fine, NARROWING):
        mu = samples.descend(mu, width, 1, 0.0)
    result = np.empty_like(mu)
    result[order] = mu
    return result


@dataclass(frozen=True)
class _Samples:
    """Samples in the order of their tree, and the sums at each of them."""

    tree: WindingTree
    lists: WindingLists

    def winding(self, mu: Array, width: Array) -> Array:
        """Return the winding number at the samples: ``A mu``."""
        return np.asarray(self.tree.winding_at(mu, self.lists, width))

    def descent(self, error: Array, width: Array) -> Array:
        """Return the negative gradient of half the squared error: ``A.T`` times the error."""
        return -np.asarray(self.tree.adjoint_at(error, self.lists, width))

    def descend(self, mu: Array, width: Array, steps: int, solved: float) -> Array:
        """Move the winding number towards one half, then take the directions of its gradient."""
        error = 0.5 - (self.winding(mu, width) if mu.any() else np.zeros(len(mu)))
        descent = direction = self.descent(error, width)
        square = float((descent**2).sum())
        for step in range(steps):
            response = self.winding(direction, width)
            scale = float((response**2).sum())
            if scale == 0.0:
                break
            mu = mu + square / scale * direction
            if step + 1 == steps:
                break
            error = error - square / scale * response
            descent = self.descent(error, width)
            before, square = square, float((descent**2).sum())
            if square < solved:
                break
            direction = descent + square / before * direction
        gradient = np.asarray(self.tree.gradient_at(mu, self.lists, width)[1])
        return np.asarray(np.linalg.norm(mu, axis=1, keepdims=True) * unit(gradient))


CROWD = 3760.0
"""A representative combines at most ``(n / CROWD) ** 0.9`` of n points, or is one of them."""


LAYER = 3.0
"""Noise divided by the spacing of the points above which they fill a thick layer. There, means of
octree cells would be up to eight times as dense in some places as in others, depending on whether a
cell was divided."""


COARSE, FINE = (1.5, 3.0), (0.7, 2.3)
"""Smoothing width at the beginning and at the end: these multiples of the distance between
representatives and of the noise level, combined as a root of squares. With a smaller width the
noise decides; with a larger one thin parts vanish."""


REGION, SAMPLED = 300, 32
"""Number of representatives whose median gives the spacing of a region: walls closer together than
the spacing keep their width, sparse regions get a larger one. The median is taken at every so
many-th representative."""


BLUR = 3.8
"""Smoothing width of the gradient at the points, divided by the noise."""


def orient_points(points: NDArray[np.float64], noise: float, spacing: float) -> NDArray[np.float64]:
    """Find outward normals at all points by a global criterion alone.

    The winding number normals of evenly chosen representatives define a smooth winding number; its
    gradient is evaluated at all points. Since no local fit is used, the two sides are distinguished
    even on parts hardly thicker than the noise, where a fit would contain both sides.

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
    (n, 3) float64
        Unit normals; on an open sheet without a preferred side, their sign is arbitrary.
    """
    x, stands = representatives(points, noise / spacing)
    tree = KdTree(x, thread_count())
    distance = regional_spacing(x, tree)
    coarse, fine = (np.hypot(a * distance, b * noise) for a, b in (COARSE, FINE))
    mu = winding_number_normals(x, distance**2, coarse, fine)
    sources = WindingTree(x, np.linalg.norm(mu, axis=1))
    width = np.maximum(fine, BLUR * noise)[stands]
    return unit(np.asarray(sources.gradient(mu, points, width, OPENING)[1]))


def representatives(
    points: NDArray[np.float64], thickness: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Combine neighbouring points into representatives, or choose some from a thick layer.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points in Morton order.
    thickness : float
        Noise divided by spacing.

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
    cells = build_octree(points, capacity)
    count = np.diff(cells.offsets)
    if thickness > LAYER:
        rows = np.linspace(0, n - 1, len(count)).astype(np.int64)
        return points[rows], np.searchsorted(rows, np.arange(n))
    stands = np.empty(n, np.int64)
    stands[cells.order] = np.repeat(np.arange(len(count)), count)
    return np.add.reduceat(cells.points, cells.offsets[:-1]) / count[:, None], stands


def regional_spacing(x: NDArray[np.float64], tree: KdTree) -> NDArray[np.float64]:
    """Find the spacing of samples in their region.

    Parameters
    ----------
    x : (m, 3) float64
        Samples in Morton order.
    tree : KdTree
        Tree of `x`.

    Returns
    -------
    (m,) float64
        Regional median of the median distance to the four nearest samples.
    """
    near = np.median(tree.query(x, min(5, len(x)), np.inf)[0][:, 1:], axis=1)
    places = np.ascontiguousarray(x[::SAMPLED])
    region = tree.query(places, min(REGION, len(x)), np.inf)[1]
    nearest = KdTree(places, thread_count()).query(x, 1, np.inf)[1][:, 0]
    return np.asarray(np.maximum(np.median(near[region], axis=1), RESOLUTION)[nearest])
