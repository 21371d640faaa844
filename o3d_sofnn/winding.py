"""Stage 5: outward sides of all points from one global criterion, the winding number."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ._kernels import KdTree, WindingTree
from .octree import build_octree
from .vectors import unit
from .winding_normals import OPENING, winding_number_normals

CROWD = 3760.0
"""A representative stands for the number of points over this, to the power of 0.9, or for one."""
LAYER = 3.0
"""Noise over the spacing of the points from which on they fill a layer: there, cells that are
halved or not make the means over them eight times as dense at one place as at another."""
COARSE, FINE = (1.5, 3.0), (0.7, 2.3)
"""Smoothing width at first and at last: so many distances of representatives, and so many standard
deviations of the noise, as legs of a right angle. Less of it and the noise decides, more and thin
parts vanish."""
REGION, SAMPLED = 300, 32
"""Representatives whose median says how far apart they are in a region: walls closer together than
that keep their width, sparse regions get a wider one. One representative of so many asks."""
BLUR = 3.8
"""Smoothing width of the gradient at the points, over the noise."""


LEANING = 0.5
"""Most weight of the winding number's normal beside one from the rules: more turns few of them to
the right side and costs all of them accuracy."""


def orient_points(
    points: NDArray[np.float64], noise: float, spacing: float, n_threads: int
) -> NDArray[np.float64]:
    """Find outward normals at all points from a global criterion alone.

    The winding number normals of an even choice of places define a smooth winding number; its
    gradient is evaluated everywhere. No local fit takes part: on parts hardly thicker than the
    noise, where a fit sees both sides, the sides are still told apart.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points in Morton order.
    noise : float
        Standard deviation of the points about the surface.
    spacing : float
        Edge of the square that one point covers.
    n_threads : int
        Threads.

    Returns
    -------
    (n, 3) float64
        Unit normals; on an open sheet without a preferred side either one.
    """
    x, stands = representatives(points, noise / spacing)
    tree = KdTree(x, n_threads)
    distance = regional_spacing(x, tree, n_threads)
    coarse, fine = (np.hypot(a * distance, b * noise) for a, b in (COARSE, FINE))
    mu = winding_number_normals(x, distance**2, coarse, fine, n_threads)
    sources = WindingTree(x, np.linalg.norm(mu, axis=1))
    width = np.maximum(fine, BLUR * noise)[stands]
    return unit(np.asarray(sources.gradient(mu, points, width, OPENING, n_threads)[1]))


def representatives(
    points: NDArray[np.float64], thickness: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Combine points that lie close together, or choose some of them from a thick layer.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points in Morton order.
    thickness : float
        Noise over spacing.

    Returns
    -------
    places : (m, 3) float64
        Means over the leaves of an octree, or points, in Morton order: half of 20,000 points, a
        fortieth of a million.
    stands : (n,) int64
        Which of them stands for each point: that of its leaf, or one close in Morton order.
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


def regional_spacing(x: NDArray[np.float64], tree: KdTree, n_threads: int) -> NDArray[np.float64]:
    """Find how far apart samples are in their region.

    Parameters
    ----------
    x : (m, 3) float64
        Samples in Morton order.
    tree : KdTree
        Over `x`.
    n_threads : int
        Threads.

    Returns
    -------
    (m,) float64
        Median over a region of the median distance to the four nearest.
    """
    near = np.median(tree.query(x, min(5, len(x)), np.inf, n_threads)[0][:, 1:], axis=1)
    places = np.ascontiguousarray(x[::SAMPLED])
    region = tree.query(places, min(REGION, len(x)), np.inf, n_threads)[1]
    nearest = KdTree(places, n_threads).query(x, 1, np.inf, n_threads)[1][:, 0]
    return np.asarray(np.median(near[region], axis=1)[nearest])


def neighborhood_areas(
    places: NDArray[np.float64], tree: KdTree, n_threads: int
) -> NDArray[np.float64]:
    """Area of surface that one sample covers, at some of them.

    Parameters
    ----------
    places : (m, 3) float64
        Samples.
    tree : KdTree
        Over all samples.
    n_threads : int
        Threads.

    Returns
    -------
    (m,) float64
        ``pi r_k^2 / k`` with the k nearest.
    """
    k = min(9, tree.size)
    distance, _ = tree.query(places, k, np.inf, n_threads)
    return np.asarray(np.pi * distance[:, -1] ** 2 / max(k - 0.5, 1.0))


def seen_from(
    viewpoint: NDArray[np.float64], points: NDArray[np.float64], sides: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Join the sides that the winding number gives with those that are seen.

    The winding number is not sure of sheets that were scanned from both sides and have no rim.

    Parameters
    ----------
    viewpoint : (3,) or (n, 3) float64
        Position of the scanner, for all points or for each of them.
    points, sides : (n, 3) float64
        Points and unit normals of either sign.

    Returns
    -------
    (n, 3) float64
        Unit vectors between the side turned to the viewpoint and the direction to it.
    """
    return unit(turned_to(viewpoint, points, sides) + unit(viewpoint - points))


def leaned(
    normals: NDArray[np.float64],
    sides: NDArray[np.float64],
    share: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Lean doubtful normals towards the winding number's, which are smoother over thin parts.

    Parameters
    ----------
    normals, sides : (n, 3) float64
        Unit normals from the rules and from the winding number, zero where there is none.
    share : (n,) float64
        Weight of the second beside the first, at most one half.

    Returns
    -------
    (n, 3) float64
        Unit normals.
    """
    return unit(normals + np.minimum(share, LEANING)[:, None] * sides)


def turned_to(
    viewpoint: NDArray[np.float64],
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Turn normals to where they were seen from.

    Parameters
    ----------
    viewpoint : (3,) or (n, 3) float64
        Position of the scanner, for all points or for each of them.
    points : (n, 3) float64
        Points.
    normals : (n, 3) float64
        Their normals, of either sign.

    Returns
    -------
    (n, 3) float64
        None has a negative product with the direction to its viewpoint.
    """
    product = np.einsum("nd,nd->n", normals, viewpoint - points)
    return np.where(product[:, None] < 0, -normals, normals)
