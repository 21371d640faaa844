"""Choice of the scale from fits of many sizes (Algorithm 1, step 6)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, fit_scales
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.sampling.local_fit import spacing_of
from o3d_sofnn.sampling.scales.noise import noise_level, untruncated
from o3d_sofnn.threads import thread_count

SCALES = np.array([8, 12, 18, 27, 40, 60, 90, 135, 200, 300, 450, 675, 1000], np.int64)
"""Neighbourhood sizes tried, a factor of 1.5 apart."""


RANDOM = 0.5
"""Mean disagreement in radians above which normals carry no information (1 for random normals)."""


FEW = 11
"""Sizes tried at first: enough for all but strong noise."""


REGION = 24
"""Number of pilots in a region."""


WIDE, ENOUGH = 0.25, 40
"""Largest residual, divided by the radius, of fits that measure the noise, and their smallest
number of points. The smallest such fit is used: in larger ones, shape adds to the noise; in smaller
ones, most of the noise is cut off."""


EDGE_ON, FRONTAL = 0.1, 0.3
"""Cosine of a normal with the ray to the sensor below which the surface would be seen edge-on, and
above which it is seen frontally."""


NEAR = 8
"""Number of neighbouring pilots that all use the largest fit that one of them needs."""


PILOTS = 1500
"""Number of places at which the scale is chosen; elsewhere the nearest one is used."""


@dataclass(frozen=True)
class Limits:
    """Largest neighbourhood of a local fit that a user allows.

    Attributes
    ----------
    max_nn : int or None
        Largest number of points; None leaves the choice to the data.
    radius : float or None
        Largest radius, in the unit of the points.
    """

    max_nn: int | None = None
    radius: float | None = None


@dataclass(frozen=True)
class Scale:
    """Local scale of the data, known at a few pilot points.

    Attributes
    ----------
    places : (p, 3) float64
        The pilot points.
    tree : KdTree
        Tree of the pilot points.
    n_neighbors : (p,) int64
        Neighbourhood size at which normals agree best with those of larger neighbourhoods.
    noise : (p,) float64
        Standard deviation of the points from the surface, in the unit of the points.
    spacing : (p,) float64
        Edge of the square that one point covers.
    least : (p,) int64
        Neighbourhood size below which fits follow the rays of the sensor instead of the surface;
        the smallest size if they do not, or if the position of the sensor is unknown.
    """

    places: NDArray[np.float64]
    tree: KdTree
    n_neighbors: NDArray[np.int64]
    noise: NDArray[np.float64]
    spacing: NDArray[np.float64]
    least: NDArray[np.int64]

    def at(self, x: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the index of the pilot nearest to each row of `x`."""
        return np.asarray(self.tree.query(x, 1, np.inf)[1][:, 0])

    def enough(self, n_neighbors: NDArray[np.int64], x: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return sizes, (n,), of neighbourhoods around `x`, raised to :attr:`least` there."""
        if not len(n_neighbors) or self.least.max() <= n_neighbors.min():
            return n_neighbors
        return np.maximum(n_neighbors, self.least[self.at(x)])


def choose_scale(
    points: NDArray[np.float64],
    tree: KdTree,
    limits: Limits,
    *,
    sight: NDArray[np.float64] | None = None,
) -> Scale:
    """Find the neighbourhood size that balances noise against detail, region by region.

    A normal fitted at one scale is compared with the normal fitted two scales above. Noise makes
    them differ if the neighbourhood is too small, and shape does if it is too large; the smallest
    mean difference in a region marks the scale to use, and the residual of the fit at that scale is
    the noise level. No prior knowledge of noise or shape is needed.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points in Morton order.
    tree : KdTree
        Tree of `points`.
    limits : Limits
        Largest neighbourhood allowed.
    sight : (n, 3) float64, optional
        Vectors of any length from the points to where they were seen from, zero where unknown.

    Returns
    -------
    Scale
        Scale at up to 1500 pilots, spread evenly over the points.
    """
    n = len(points)
    sizes = sizes_to_try(n, limits.max_nn)
    rows = np.linspace(0, n - 1, min(n, PILOTS)).astype(np.int64)
    pilots = points[rows]
    pilot_tree = KdTree(pilots, thread_count())
    region = pilot_tree.query(pilots, min(REGION, len(pilots)), np.inf)[1]
    normals = np.empty((len(pilots), 0, 3))
    rms, radii = np.empty((2, len(pilots), 0))
    for some in (sizes[:FEW], sizes[FEW:]):
        fits = fit_scales(tree, points, pilots, some)
        normals, rms, radii = (
            np.concatenate([known, more], axis=1)
            for known, more in zip((normals, rms, radii), fits[:3], strict=True)
        )
        cosine = np.abs(np.einsum("psd,psd->ps", normals[:, :-2], normals[:, 2:]))
        disagreement = np.arccos(np.clip(cosine, 0.0, 1.0))
        regional = (disagreement[region].mean(axis=1) + 0.25 * disagreement.mean(axis=0)) / 1.25
        # Below the noise both normals are random and agree by chance: that minimum does not count.
        rising = np.zeros(regional.shape, bool)
        rising[:, :-1] = (regional[:, 1:] >= regional[:, :-1]) & (regional[:, :-1] < RANDOM)
        if (~rising.any(axis=1)).mean() < 0.05 or len(sizes) <= FEW:
            break
    # Take the first minimum: above the size of a thin part, wrong normals agree with each other.
    chosen = np.where(rising.any(axis=1), rising.argmax(axis=1), regional.argmin(axis=1))
    row = np.arange(len(pilots))
    least = np.zeros(len(pilots), np.int64)
    if sight is not None:
        least = least_facing(normals, unit(sight[rows]), region[:, :NEAR])
    chosen = np.minimum(np.maximum(chosen, least), max(regional.shape[1] - 1, 0))
    chosen, least = (within(some, sizes, radii, limits) for some in (chosen, least))
    telling = (rms < WIDE * radii) & (sizes[: rms.shape[1]] >= ENOUGH)
    smallest = np.where(telling.any(axis=1), telling.argmax(axis=1), chosen)
    rms = untruncated(rms, radii)
    low = np.minimum(smallest, np.maximum(chosen - 1, 0))
    low = np.maximum(low, np.minimum(least, chosen))  # a rod along the rays shows no noise
    high = np.minimum(np.maximum(chosen + 1, 2), len(sizes) - 1)
    noise = noise_level(rms[row, low], rms[row, high], sizes[low], sizes[high])
    noise = np.minimum(noise, rms[row, chosen])
    noise = np.median(noise[region], axis=1)
    spacing = spacing_of(radii[row, chosen], sizes[chosen])
    spacing = np.median(spacing[region], axis=1)
    return Scale(pilots, pilot_tree, sizes[chosen], noise, spacing, sizes[least])


def least_facing(
    normals: NDArray[np.float64], rays: NDArray[np.float64], near: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Find the size below which fits lie along the rays of the sensor.

    If the spacing of points is smaller than their range error, a small neighbourhood is a rod along
    the rays: the fitted plane contains the rays, even if small neighbourhoods agree with each
    other. A surface that is edge-on in small fits and frontal in larger ones is frontal.

    Parameters
    ----------
    normals : (p, s, 3) float64
        Unit normals of either sign, of fits of ascending sizes.
    rays : (p, 3) float64
        Unit vectors to the sensor, zero where unknown.
    near : (p, k) int64
        Neighbouring pilots of each pilot, including itself.

    Returns
    -------
    (p,) int64
        Index of the smallest size from which no neighbouring pilot is edge-on; 0 where all sizes
        are usable.
    """
    facing = np.abs(np.einsum("psd,pd->ps", normals, rays))
    known = np.einsum("pd,pd->p", rays, rays) > 0.0
    larger = np.maximum.accumulate(facing[:, ::-1], axis=1)[:, ::-1]
    edge_on = (facing < EDGE_ON) & (larger > FRONTAL) & known[:, None]
    last = edge_on.shape[1] - edge_on[:, ::-1].argmax(axis=1)
    least = np.where(edge_on.any(axis=1), last, 0)
    return np.asarray(least[near].max(axis=1))


def within(
    chosen: NDArray[np.int64],
    sizes: NDArray[np.int64],
    radii: NDArray[np.float64],
    limits: Limits,
) -> NDArray[np.int64]:
    """Reduce chosen neighbourhoods that are larger than the user allows.

    Parameters
    ----------
    chosen : (p,) int64
        Index of a size at each pilot.
    sizes : (s,) int64
        Neighbourhood sizes, ascending.
    radii : (p, t) float64
        Radii of the neighbourhoods of the first t sizes.
    limits : Limits
        What the user allows.

    Returns
    -------
    (p,) int64
        Index of a size; 0 where not even the smallest is allowed.
    """
    allowed = np.ones(radii.shape, bool)
    if limits.max_nn is not None:
        allowed &= sizes[: radii.shape[1]] <= limits.max_nn
    if limits.radius is not None:
        allowed &= radii <= limits.radius
    return np.asarray(np.minimum(chosen, np.maximum(allowed.sum(axis=1) - 1, 0)))


def sizes_to_try(n_points: int, max_neighbors: int | None) -> NDArray[np.int64]:
    """Return neighbourhood sizes for a cloud, two more than may be chosen.

    Parameters
    ----------
    n_points : int
        Number of points in the cloud.
    max_neighbors : int or None
        Largest neighbourhood allowed.

    Returns
    -------
    (s,) int64
        Sizes in ascending order.
    """
    limit = max(min(max_neighbors or n_points, n_points // 20), SCALES[0])
    return np.minimum(SCALES[: np.searchsorted(SCALES, limit, "right") + 2], n_points)
