"""Stage 5: which parts of the surface are visible from a place, and which are hidden."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, fit_scales
from o3d_sofnn.geometry.frame import Frame
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.sampling.local_fit import spacing_of
from o3d_sofnn.threads import thread_count

if TYPE_CHECKING:
    from o3d_sofnn.sampling.outliers import Samples

Array = NDArray[np.float64]


DISCS = 6000
"""Number of discs that represent the surface when views are compared: fewer blur the occlusion."""


SIZES = np.array([27, 60, 135], np.int64)
"""Numbers of points in a fit: 27 give the area of a point to a fifth, more are for noise."""


IMAGE, HITS = 24, 2
"""Number of neighbours in the image that may hide a place, and how many must hide it."""


BESIDE, LEAP = 6, 0.3
"""Number of neighbours in the image that are tested for range jumps, and smallest sine of the angle
between a jump and the surface on both sides."""


GAP = 2.5
"""Depth, divided by the spacing of the discs, between occluders and one curved or noisy layer."""


@dataclass(frozen=True)
class Discs:
    """Flat discs on the surface, spread evenly over the points.

    Attributes
    ----------
    places : (p, 3) float64
        Centres of the discs.
    normals : (p, 3) float64
        Unit normals of either sign.
    areas : (p,) float64
        Area that one point of the cloud covers there.
    reach : (p,) float64
        Radius of the disc: the distance between neighbouring discs.
    """

    places: Array
    normals: Array
    areas: Array
    reach: Array

    @classmethod
    def of(cls, samples: Samples, count: int) -> Discs:
        """Fit discs at `count` of the samples."""
        n = len(samples.points)
        rows = np.linspace(0, n - 1, min(n, count)).astype(np.int64)
        places = np.ascontiguousarray(samples.points[rows])
        sizes = np.unique(np.minimum(SIZES, n))
        normals, _, radius, _ = fit_scales(samples.tree, samples.points, places, sizes)
        wanted = samples.scale.n_neighbors[samples.scale.at(places)]
        column = np.minimum(np.searchsorted(sizes, wanted), len(sizes) - 1)
        row = np.arange(len(places))
        areas = spacing_of(radius[row, column], sizes[column]) ** 2
        reach = np.sqrt(areas * (n / len(rows)))
        return cls(places, normals[row, column], areas, reach)

    def rows(self, mask: NDArray[np.bool_]) -> Discs:
        """Return the discs in a mask, (p,) bool."""
        return Discs(
            np.ascontiguousarray(self.places[mask]),
            self.normals[mask],
            self.areas[mask],
            self.reach[mask],
        )


class Sight(Protocol):
    """Where points were seen from."""

    def directions(self, x: Array) -> Array:
        """Return vectors, (n, 3), from places to their viewpoints; zero where unknown."""


@dataclass(frozen=True)
class Station:
    """A place to look from.

    Attributes
    ----------
    place : (3,) float64
        The place, or the direction to a viewer who is infinitely far away.
    far : bool
        Whether it is a direction.
    """

    place: Array
    far: bool = False

    def directions(self, x: Array) -> Array:
        """See :class:`Sight`."""
        return np.broadcast_to(self.place, x.shape) if self.far else self.place - x

    def outside(self, frame: Frame) -> Station:
        """Return the same in the user's coordinates."""
        return self if self.far else Station(frame.outside(self.place))

    def image(self, x: Array) -> Array:
        """Project places, (n, 3), onto the unit sphere around the station, or onto a plane."""
        if not self.far:
            return np.ascontiguousarray(unit(x - self.place))
        way = self.place / np.linalg.norm(self.place)
        return np.ascontiguousarray(x - np.outer(x @ way, way))


@dataclass(frozen=True)
class Rows:
    """One viewpoint for each row, (n, 3), of a cloud."""

    places: Array

    def directions(self, x: Array) -> Array:
        """See :class:`Sight`; `x` has the same rows."""
        return self.places - x


@dataclass(frozen=True)
class Partly:
    """A place from which part of the surface is seen; the viewpoint of the rest is unknown.

    Attributes
    ----------
    station : Station
        The place.
    surface : (p, 3) float64
        Places on the surface.
    seen : (p,) bool
        Which of them are seen.
    """

    station: Station
    surface: Array
    seen: NDArray[np.bool_]

    def directions(self, x: Array) -> Array:
        """See :class:`Sight`; zero where the nearest place on the surface is not seen."""
        nearest = _nearest(self.surface, x)
        return np.where(self.seen[nearest, None], self.station.directions(x), 0.0)

    def outside(self, frame: Frame) -> Partly:
        """Return the same in the user's coordinates."""
        surface = frame.outside(self.surface)
        return Partly(self.station.outside(frame), surface, self.seen)


@dataclass(frozen=True)
class Several:
    """Several places to look from.

    Attributes
    ----------
    places : (k, 3) float64
        The places.
    surface : (p, 3) float64
        Places on the surface.
    seen : (k, p) bool
        Whether each place on the surface is seen from each station.
    """

    places: Array
    surface: Array
    seen: NDArray[np.bool_]

    def directions(self, x: Array) -> Array:
        """See :class:`Sight`: the mean direction of the rays that hit a place."""
        seen = self.seen[:, _nearest(self.surface, x)]
        seen = seen | ~seen.any(axis=0)
        total = np.zeros(x.shape)
        for place, rows in zip(self.places, seen, strict=True):
            ray = place - x
            total += (rows / np.maximum(np.linalg.norm(ray, axis=1), 1e-300) ** 3)[:, None] * ray
        return total


def _nearest(surface: Array, x: Array) -> NDArray[np.int64]:
    tree = KdTree(np.ascontiguousarray(surface), thread_count())
    return np.asarray(tree.query(np.ascontiguousarray(x), 1, np.inf)[1][:, 0])


def hidden(discs: Discs, station: Station, asked: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Find the discs that others hide from a station.

    Parameters
    ----------
    discs : Discs
        The surface.
    station : Station
        The station.
    asked : (m,) int64
        Indices of the discs to test.

    Returns
    -------
    (m,) bool
        True if the ray to the station passes through at least two other discs that are farther in
        front of the tested disc than neighbours on the same surface.
    """
    image = station.image(discs.places)
    tree = KdTree(image, thread_count())
    count = min(IMAGE + 1, len(image))
    index = tree.query(np.ascontiguousarray(image[asked]), count, np.inf)[1]
    index = index[:, 1:]
    places, rays = discs.places[asked], station.directions(discs.places[asked])
    length = np.linalg.norm(rays, axis=1)
    rays = rays / np.maximum(length, 1e-300)[:, None]
    step = discs.places[index] - places[:, None]
    normals, reach = discs.normals[index], discs.reach[index]
    height = np.einsum("mkd,mkd->mk", normals, step)
    slant = np.einsum("mkd,md->mk", normals, rays)
    met = np.abs(slant) > 1e-9
    along = height / np.where(met, slant, 1.0)  # where the ray intersects the plane of the disc
    off = along[:, :, None] * rays[:, None] - step
    gap = GAP * np.maximum(reach, discs.reach[asked][:, None])
    hit = met & (np.einsum("mkd,mkd->mk", off, off) < reach**2) & (along > gap)
    if not station.far:
        hit &= along < length[:, None]
    return np.asarray(hit.sum(axis=1) >= HITS)


def jumps(discs: Discs, place: Array) -> float:
    """Return the share of the discs that a place sees beside much nearer or farther ones.

    Parameters
    ----------
    discs : Discs
        The surface.
    place : (3,) float64
        The place.

    Returns
    -------
    float
        Share from 0 to 1; 0 for a convex surface around the place.
    """
    image = Station(place).image(discs.places)
    count = min(BESIDE + 1, len(image))
    beside = KdTree(image, thread_count()).query(image, count, np.inf)[1][:, 1:]
    step = discs.places[beside] - discs.places[:, None]
    length = np.maximum(np.linalg.norm(step, axis=2), 1e-300)
    across = np.minimum(
        np.abs(np.einsum("pkd,pkd->pk", step, discs.normals[beside])),
        np.abs(np.einsum("pkd,pd->pk", step, discs.normals)),
    )
    far = length > GAP * np.maximum(discs.reach[beside], discs.reach[:, None])
    return float((far & (across > LEAP * length)).any(axis=1).mean())
