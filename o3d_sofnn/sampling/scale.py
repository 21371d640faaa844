"""Stage 2: local plane and quadric fits, their scale and the noise level."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, fit_scales
from o3d_sofnn.sampling.local_fit import Neighborhoods, fit_quadrics, sides_around, spacing_of

SCALES = np.array([8, 12, 18, 27, 40, 60, 90, 135, 200, 300, 450, 675, 1000], np.int64)
"""Neighbourhood sizes tried, a factor of 1.5 apart."""


RANDOM = 0.5
"""Mean disagreement in radians above which normals carry no information (unrelated ones: 1)."""


FEW = 11
"""Sizes tried at first: enough for all but strong noise."""


REGION = 24
"""Pilots that make a region."""


TRUNCATED, POWER = 0.36, 2.6
"""Residual over the radius of a fit that points all over its ball leave, and exponent of the share
of Gaussian noise that such a ball cuts off (simulated)."""


LARGEST = 0.5
"""Ratio to the former up to which this is made good for: beyond, it may be a second sheet that the
ball holds."""


WIDE, ENOUGH = 0.25, 40
"""Residual over radius of the fits that tell the noise, the smallest of these with so many points:
in larger ones shape adds to it, in smaller ones most of it is cut off."""


PILOTS = 1500
"""Places at which the scale is chosen; in between the nearest one speaks."""


@dataclass(frozen=True)
class Limits:
    """Largest neighbourhood of a local fit that a user allows.

    Attributes
    ----------
    max_nn : int or None
        In points; None for no limit but the data's.
    radius : float or None
        In the unit of the points.
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
        Over them.
    n_neighbors : (p,) int64
        Neighbourhood size at which normals agree best with those of larger neighbourhoods.
    noise : (p,) float64
        Standard deviation of the points about the surface, in the unit of the points.
    spacing : (p,) float64
        Edge of the square that one point covers.
    """

    places: NDArray[np.float64]
    tree: KdTree
    n_neighbors: NDArray[np.int64]
    noise: NDArray[np.float64]
    spacing: NDArray[np.float64]

    def at(self, x: NDArray[np.float64], n_threads: int) -> NDArray[np.int64]:
        """Index of the pilot that speaks for each row of `x`."""
        return np.asarray(self.tree.query(x, 1, np.inf, n_threads)[1][:, 0])


def choose_scale(
    points: NDArray[np.float64],
    tree: KdTree,
    limits: Limits,
    n_threads: int,
) -> Scale:
    """Find the neighbourhood size that balances noise against detail, region by region.

    A normal fitted at one scale is compared with the one fitted two scales further up. Noise makes
    them differ when the neighbourhood is too small, the shape does when it is too large; the
    smallest mean difference over a region marks the scale to use, and the residual of the fit at
    that scale is the noise level. Nothing is assumed of either beforehand.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points in Morton order.
    tree : KdTree
        Over `points`.
    limits : Limits
        Largest neighbourhood allowed.
    n_threads : int
        Threads.

    Returns
    -------
    Scale
        At up to 1500 pilots, evenly spread over the points.
    """
    n = len(points)
    sizes = sizes_to_try(n, limits.max_nn)
    pilots = points[np.linspace(0, n - 1, min(n, PILOTS)).astype(np.int64)]
    pilot_tree = KdTree(pilots, n_threads)
    region = pilot_tree.query(pilots, min(REGION, len(pilots)), np.inf, n_threads)[1]
    normals = np.empty((len(pilots), 0, 3))
    rms, radii = np.empty((2, len(pilots), 0))
    for some in (sizes[:FEW], sizes[FEW:]):
        fits = fit_scales(tree, points, pilots, some, n_threads)
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
    # The first minimum: beyond the size of a thin part wrong normals agree with each other.
    chosen = np.where(rising.any(axis=1), rising.argmax(axis=1), regional.argmin(axis=1))
    row = np.arange(len(pilots))
    chosen = limit_radius(chosen, radii, limits.radius)
    telling = (rms < WIDE * radii) & (sizes[: rms.shape[1]] >= ENOUGH)
    smallest = np.where(telling.any(axis=1), telling.argmax(axis=1), chosen)
    rms = untruncated(rms, radii)
    low = np.minimum(smallest, np.maximum(chosen - 1, 0))
    high = np.minimum(np.maximum(chosen + 1, 2), len(sizes) - 1)
    noise = noise_level(rms[row, low], rms[row, high], sizes[low], sizes[high])
    noise = np.minimum(noise, rms[row, chosen])
    noise = np.median(noise[region], axis=1)
    spacing = spacing_of(radii[row, chosen], sizes[chosen])
    return Scale(pilots, pilot_tree, sizes[chosen], noise, np.median(spacing[region], axis=1))


def limit_radius(
    chosen: NDArray[np.int64], radius: NDArray[np.float64], max_radius: float | None
) -> NDArray[np.int64]:
    """Choose smaller neighbourhoods where the chosen ones, (p,) of (p, s), are too wide."""
    if max_radius is None:
        return chosen
    return np.asarray(np.minimum(chosen, np.maximum((radius <= max_radius).sum(axis=1) - 1, 0)))


def sizes_to_try(n_points: int, max_neighbors: int | None) -> NDArray[np.int64]:
    """Neighbourhood sizes for a cloud, two more than may be chosen.

    Parameters
    ----------
    n_points : int
        Points of the cloud.
    max_neighbors : int or None
        Largest neighbourhood allowed.

    Returns
    -------
    (s,) int64
        Ascending.
    """
    limit = max(min(max_neighbors or n_points, n_points // 20), SCALES[0])
    return np.minimum(SCALES[: np.searchsorted(SCALES, limit, "right") + 2], n_points)


def untruncated(rms: NDArray[np.float64], radius: NDArray[np.float64]) -> NDArray[np.float64]:
    """Make good for the part of the noise that lies outside the balls of the fits.

    Parameters
    ----------
    rms, radius : (...) float64
        Residuals of quadric fits and their radii.

    Returns
    -------
    (...) float64
        Standard deviation of the noise: `rms` where that is much less than the radius, up to 1.1
        times as much elsewhere.
    """
    ratio = np.minimum(rms / np.maximum(radius, 1e-300), LARGEST * TRUNCATED)
    return np.asarray(rms / np.sqrt(1.0 - (ratio / TRUNCATED) ** POWER))


def noise_level(
    fine: NDArray[np.float64],
    coarse: NDArray[np.float64],
    n_fine: NDArray[np.int64],
    n_coarse: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Separate noise from shape in the residuals of quadric fits at two scales.

    Noise leaves the same residual at every scale; what a quadric misses of the shape grows with the
    third power of the radius, so its square with the third power of the number of points.

    Parameters
    ----------
    fine, coarse : (p,) float64
        Root-mean-square residuals.
    n_fine, n_coarse : (p,) int64
        Points in the fits.

    Returns
    -------
    (p,) float64
        Standard deviation of the noise.
    """
    ratio = (n_fine / n_coarse) ** 3.0
    rest = (fine**2 - ratio * coarse**2) / np.maximum(1.0 - ratio, 1e-3)
    return np.sqrt(np.maximum(rest, 0.0))


HEIGHTS = 4.0
"""Weight of a difference in height, over the radius of a middling fit, against one in radians."""


REFERENCE = 4
"""Place of that fit among the sizes."""


def refine_scale(
    points: NDArray[np.float64],
    tree: KdTree,
    scale: Scale,
    sides: NDArray[np.float64],
    limits: Limits,
    n_threads: int,
) -> Scale:
    """Choose the neighbourhood size anew, from fits that leave the other side of a part out.

    As in :func:`choose_scale` a fit is compared with the one two sizes further up, now in the
    normal and in the height of the surface: on a tube the normals of ever larger fits agree, by
    symmetry, while their heights drift. Wrong normals no longer agree beyond the size of a thin
    part, so that the smallest difference of all sizes counts, not the first one.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points.
    tree : KdTree
        Over `points`.
    scale : Scale
        The first choice.
    sides : (n, 3) float64
        Unit normals of the points.
    limits, n_threads
        As in :func:`choose_scale`.

    Returns
    -------
    Scale
        At the same pilots, noise and spacing as before.
    """
    sizes = sizes_to_try(len(points), limits.max_nn)
    places = scale.places
    nearest = tree.query(places, 1, np.inf, n_threads)[1][:, 0]
    facing = sides_around(places, sides[nearest], sides, tree, n_threads)
    fits = [
        fit_quadrics(
            tree,
            points,
            sides,
            Neighborhoods(places, facing, np.full(len(places), size), scale.noise),
            n_threads,
        )
        for size in sizes
    ]
    normals = np.stack([fit.normals for fit in fits], axis=1)
    radius = np.stack([fit.radius for fit in fits], axis=1)
    feet = np.stack([fit.feet for fit in fits], axis=1)
    height = np.einsum("psd,pd->ps", feet - places[:, None], facing)
    unit = radius[:, min(REFERENCE, len(sizes) - 1), None]
    cosine = np.einsum("psd,psd->ps", normals[:, :-2], normals[:, 2:])
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    difference = angle + HEIGHTS * np.abs(height[:, :-2] - height[:, 2:]) / unit
    region = scale.tree.query(places, min(REGION, len(places)), np.inf, n_threads)[1]
    same = np.einsum("pkd,pd->pk", facing[region], facing) > 0.0
    regional = np.einsum("pk,pks->ps", same, difference[region]) / same.sum(axis=1)[:, None]
    chosen = (regional + 0.25 * difference.mean(axis=0)).argmin(axis=1)
    chosen = limit_radius(chosen, radius, limits.radius)
    first = np.searchsorted(sizes, scale.n_neighbors)
    return replace(scale, n_neighbors=sizes[(first + chosen + 1) // 2])
