"""Stage 2: points that hang between objects, as seen from where the scanner stood."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.geometry.vectors import longest_side
from o3d_sofnn.sampling.scales.choice import Scale
from o3d_sofnn.threads import thread_count

BESIDE = 8
"""Number of neighbours in direction."""


COMPANY = 2
"""How many of them are near if the point is on a surface: on the steepest surface these are the
points at the same distance from the scanner, and at its border those on one side."""


NEAR, NOISY = 5.0, 4.0
"""Largest distance that counts as near: these multiples of the distance between rays there and of
the noise level, added. This finds 0.89 of the points that hang in the air behind a ball, 0.016 of a
floor seen by random rays at up to 87 degrees, and none of a floor seen by rows of rays. With 3
instead of 5, the shares are 0.96 and 0.057."""


VEILED = 0.1
"""Largest share of points between objects. If there seem to be more, the points were not all seen
from this place, or everything is leaves and wires."""


VIEW = 100
"""Smallest number of points in a view."""


PARALLEL = 1e6
"""Distance of a viewpoint, divided by the size of the cloud, above which directions have too few
digits."""


def between(
    points: NDArray[np.float64],
    viewpoint: NDArray[np.float64] | None,
    scale: Scale,
) -> NDArray[np.bool_]:
    """Mark points that hang in the air between an object and the background.

    Where a ray hits the edge of an object, the scanner measures a distance between the object and
    the background (mixed or flying pixels). Such points form rows along the rays, far from their
    neighbours in direction. Points on a surface are near them, even at grazing angles.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points.
    viewpoint : (3,) or (n, 3) float64 or None
        Where all points were seen from, or each of them; None if unknown.
    scale : Scale
        Scale of the same points.

    Returns
    -------
    (n,) bool
        True for points between objects; all False without a viewpoint.

    References
    ----------
    Compare the jump edge filter of May et al. 2009, "Three-dimensional mapping with time-of-flight
    cameras", which examines the angles between neighbouring pixels.
    """
    hanging = np.zeros(len(points), bool)
    if viewpoint is None:
        return hanging
    noise = scale.noise[scale.at(points)]
    if viewpoint.ndim == 1:
        return _hanging(points - viewpoint, noise)
    places, view, count = np.unique(viewpoint, axis=0, return_inverse=True, return_counts=True)
    by_view, ends = np.argsort(view.ravel(), kind="stable"), np.cumsum(count)
    for i in np.flatnonzero(count >= VIEW):
        rows = by_view[ends[i] - count[i] : ends[i]]
        hanging[rows] = _hanging(points[rows] - places[i], noise[rows])
    return hanging


def _hanging(seen: NDArray[np.float64], noise: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark points between objects among points that were seen from the origin."""
    distance = np.maximum(np.linalg.norm(seen, axis=1), 1e-300)
    if len(seen) < VIEW or distance.min() > PARALLEL * longest_side(seen):
        return np.zeros(len(seen), bool)
    rays = seen / distance[:, None]
    angle, near = KdTree(rays, thread_count()).query(rays, BESIDE + 1, np.inf)
    apart = distance * angle[:, -1] * np.sqrt(np.pi / BESIDE)
    reach = NEAR * apart + NOISY * noise
    beside = np.linalg.norm(seen[near[:, 1:]] - seen[:, None], axis=2) <= reach[:, None]
    alone = beside.sum(axis=1) < COMPANY
    return np.asarray(alone & (alone.mean() <= VEILED))
