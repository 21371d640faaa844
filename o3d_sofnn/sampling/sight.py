"""Stage 2: points between things, as seen from where the scanner stood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.geometry.vectors import longest_side
from o3d_sofnn.sampling.scales.choice import Scale

BESIDE = 8
"""Points that are next in direction."""


COMPANY = 2
"""How many of them must be near, where a surface is: on the steepest there are those at the same
distance from the scanner, and at its border those on one side."""


NEAR, NOISY = 5.0, 4.0
"""How near that is: over the distance between rays there, plus over the noise level. Of the points
that hang in the air behind a ball 0.89 are found; of a floor seen by random rays at up to 87
degrees 0.016, of one seen by rows of rays none. With 3 they are 0.96 and 0.057."""


VEILED = 0.1
"""Largest share of points between things. Where more seem to be, the place is none from which all
were seen, or everything is leaves and wires."""


VIEW = 100
"""Fewest points that make a view."""


PARALLEL = 1e6
"""Distance of a viewpoint over the size of the cloud from which on directions have too few
digits."""


def between(
    points: NDArray[np.float64],
    viewpoint: NDArray[np.float64] | None,
    scale: Scale,
    n_threads: int,
) -> NDArray[np.bool_]:
    """Mark points that hang in the air between a thing and what is behind it.

    Where a ray meets the edge of a thing, the scanner measures something between the thing and what
    is behind (mixed or flying pixels). Such points stand in rows along the rays, far from those
    that are next to them in direction. Points of a surface are not, however steeply it is seen.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points.
    viewpoint : (3,) or (n, 3) float64 or None
        Where all were seen from, or each; None where nobody knows.
    scale : Scale
        Of the same points.
    n_threads : int
        Threads.

    Returns
    -------
    (n,) bool
        True for points between things; none without a viewpoint.

    References
    ----------
    Compare the jump edge filter of May et al. 2009, "Three-dimensional mapping with time-of-flight
    cameras", which looks at the angles to pixels that are next to each other.
    """
    hanging = np.zeros(len(points), bool)
    if viewpoint is None:
        return hanging
    noise = scale.noise[scale.at(points, n_threads)]
    if viewpoint.ndim == 1:
        return _hanging(points - viewpoint, noise, n_threads)
    places, view, count = np.unique(viewpoint, axis=0, return_inverse=True, return_counts=True)
    by_view, ends = np.argsort(view.ravel(), kind="stable"), np.cumsum(count)
    for i in np.flatnonzero(count >= VIEW):
        rows = by_view[ends[i] - count[i] : ends[i]]
        hanging[rows] = _hanging(points[rows] - places[i], noise[rows], n_threads)
    return hanging


def _hanging(
    seen: NDArray[np.float64], noise: NDArray[np.float64], n_threads: int
) -> NDArray[np.bool_]:
    """Mark points between things among those that were seen from the origin."""
    distance = np.maximum(np.linalg.norm(seen, axis=1), 1e-300)
    if len(seen) < VIEW or distance.min() > PARALLEL * longest_side(seen):
        return np.zeros(len(seen), bool)
    rays = seen / distance[:, None]
    angle, near = KdTree(rays, n_threads).query(rays, BESIDE + 1, np.inf, n_threads)
    apart = distance * angle[:, -1] * np.sqrt(np.pi / BESIDE)
    reach = NEAR * apart + NOISY * noise
    beside = np.linalg.norm(seen[near[:, 1:]] - seen[:, None], axis=2) <= reach[:, None]
    alone = beside.sum(axis=1) < COMPANY
    return np.asarray(alone & (alone.mean() <= VEILED))
