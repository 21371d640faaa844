"""Stage 5: where scanners stood, found from the density of the points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.geometry.vectors import even_directions
from o3d_sofnn.orientation.density import Density, Fit, spread_of
from o3d_sofnn.orientation.visibility import DISCS, Discs, Station, hidden, jumps
from o3d_sofnn.sampling.outliers import Samples
from o3d_sofnn.threads import thread_count

Array = NDArray[np.float64]


ASKED = 1500
"""Number of discs whose density and visibility are examined."""


UNEVEN = 0.2, 0.7
"""Spread of the logarithm of the area per point above which one station, or several together, are
searched for: with less there is too little to explain."""


EXPLAINED, WELL = (0.45, 0.12), 0.15
"""Largest share of that spread that one station may leave unexplained, and that several may leave;
below the last value no further station is searched for."""


FEWER = 2.0
"""Largest spread left by fewer stations, divided by the spread left by more, for which fewer are
preferred."""


FAR = 10.0
"""Distance, divided by the size of the scene, above which the density cannot distinguish a station
from one on the opposite side."""


HIDDEN, SURELY = 0.15, 0.05
"""Largest share of the discs that a station does not see. Above the second value (for example with
the sparse rings of a scanner on a car) a single station is trusted for open surfaces only, and
several are not trusted at all: if an object is thirty times as dense at one end, a place beside
that end sees most of it."""


AROUND = 500, 4.0
"""A station is inside if there is a disc in each of this many directions, at most this many times
the distance between discs away from the direction."""


INSIDE, JUMPS = 0.06, 0.005
"""Largest share that such a station does not see, and smallest share of the discs beside jumps of
the range: with fewer the density must be explained `WELL`, because uneven balls look the same."""


RIVALS, APART, MOST = 1.3, 0.02, 4
"""Rivals are places that leave a spread of at most this multiple of the best one's; the rival that
sees most is chosen. Distance, divided by the size of the scene, below which two places are the
same. Largest number of rivals that are examined."""


ALIKE = 0.05
"""Largest difference in hidden shares for which the better fit of two rivals is chosen."""


MIRRORED = 0.3
"""Hidden share of a station's mirror image (on the other side of the nearest surface), divided by
the station's own, below which the image is chosen instead."""


CENTRAL = 0.05
"""Distance from the centre of the area, divided by the size of the scene, below which a station is
rejected: objects sampled around their centre have the same density as a room seen from there."""


CLOSEST, CLEARANCE = 0.02, 0.4
"""Share of the discs that count as nearest to a station, and smallest ratio of their range to the
spacing of discs there, relative to elsewhere: points are dense at the poles of a ball of longitudes
and latitudes, too. Measured: 0.2 there, at least 0.59 for 17 scans."""


ORIGIN, NEARBY = 1.5, 0.15
"""Largest ratio of the spread left by the origin to the spread left by the station, and largest
distance between them, divided by the size of the scene, for which the origin is chosen instead:
sensors are at their own origin."""


SEVERAL = 3
"""Largest number of stations that are searched for together."""


@dataclass(frozen=True)
class Found:
    """Stations that explain the density.

    Attributes
    ----------
    stations : tuple of Station
        One to three places.
    left : float
        Spread of the density that they leave unexplained, divided by the total spread.
    hidden : float
        Share of the discs that are hidden from the station that contributes most to their density.
    discs : Discs
        The surface.
    """

    stations: tuple[Station, ...]
    left: float
    hidden: float
    discs: Discs

    @property
    def sure(self) -> bool:
        """Whether almost nothing is hidden."""
        return self.hidden <= SURELY


def find_stations(samples: Samples, origin: Array) -> Found | None:
    """Find the places from which scanners would produce the density of the points.

    A scanner sends out its rays uniformly: the area that one point covers, multiplied by the cosine
    of incidence and divided by the squared range, is constant. The densities of several scanners
    add up. Gauss-Newton steps from many starts find the places that minimise the spread of the
    logarithm of this quantity. No place outside a closed object sees all of it, and none inside
    explains its density, whatever the sampling.

    Parameters
    ----------
    samples : Samples
        The points.
    origin : (3,) float64
        Origin of the user's coordinates, in those of the samples.

    Returns
    -------
    Found or None
        None if the density is uniform, or if no station explains it and sees the surface.
    """
    some = Discs.of(samples, ASKED)
    raw = spread_of(np.log(some.areas))
    if raw < UNEVEN[0]:
        return None
    densities = [Density.of(some, turning) for turning in (False, True)]
    discs: Discs | None = None
    found: list[Found] = []
    fits: list[Fit] = []
    for count in range(1, SEVERAL + 1 if raw > UNEVEN[1] else 2):
        fits = [fit for density in densities for fit in density.fits(count, fits)]
        fits.sort(key=lambda fit: fit.spread)
        if count == 1 and _is_near(origin, fits[0], densities):
            fits.insert(0, Fit(origin[None], fits[0].spread))
        several = int(count > 1)
        if fits[0].spread > EXPLAINED[several] * raw:
            continue
        discs = discs or Discs.of(samples, DISCS)
        best = _most_seen(fits, densities, discs)
        if best and best.hidden <= (SURELY if several else HIDDEN):
            found.append(replace(best, left=best.left / raw))
        if found and found[-1].left < WELL:
            break
    least = min((each.left for each in found), default=0.0)
    found = [each for each in found if each.left <= FEWER * least]
    return found[0] if found and _is_scanner(found[0], densities[0].size) else None


def _is_near(origin: Array, fit: Fit, densities: list[Density]) -> bool:
    """Return whether the origin is close to the station and explains about as much."""
    near = np.linalg.norm(fit.stations[0] - origin) <= NEARBY * densities[0].size
    left = min(density.spread(origin[None]) for density in densities)
    return bool(near and left <= ORIGIN * fit.spread)


def _is_scanner(found: Found, size: float) -> bool:
    """Return False if the station is rather inside a closed object."""
    discs, station = found.discs, found.stations[0]
    centre = discs.areas @ discs.places / discs.areas.sum()
    if np.linalg.norm(station.place - centre) < CENTRAL * size:
        return False
    ranges = np.linalg.norm(discs.places - station.place, axis=1)
    apart = discs.reach > 1e-6 * np.median(discs.reach)
    farness = ranges[apart] / discs.reach[apart]
    nearest = np.argsort(ranges[apart], kind="stable")[: max(1, int(CLOSEST * len(ranges)))]
    if np.median(farness[nearest]) < CLEARANCE * np.median(farness):
        return False
    distance = AROUND[1] * float(np.sqrt(4.0 * np.pi / len(discs.places)))
    if len(found.stations) > 1 or not _surrounds(discs, station.place, AROUND[0], distance):
        return True
    convex = jumps(discs, station.place) < JUMPS
    return found.hidden <= INSIDE and (found.left < WELL or not convex)


def _most_seen(fits: list[Fit], densities: list[Density], discs: Discs) -> Found | None:
    """Return the stations that see most, among those that explain the density about as well."""
    rivals: list[Fit] = []
    size, middle = densities[0].size, densities[0].middle
    for fit in fits:
        close = any(np.abs(fit.stations - r.stations).max() < APART * size for r in rivals)
        far = np.linalg.norm(fit.stations - middle, axis=1).max() > FAR * size
        if fit.spread <= RIVALS * fits[0].spread and not close and not far:
            rivals.append(fit)
    seen = [_seen(fit, densities, discs) for fit in rivals[:MOST]]
    least = min((each.hidden for each in seen), default=0.0)
    return next((each for each in seen if each.hidden <= least + ALIKE), None)


def _seen(fit: Fit, densities: list[Density], discs: Discs) -> Found:
    """Judge each station, or its mirror image, by the discs whose density it contributes most to.

    The mirror image of a station on the other side of a flat ground produces the same density.
    """
    rows = np.linspace(0, len(discs.places) - 1, min(ASKED, len(discs.places))).astype(np.int64)
    places, normals = discs.places[rows], discs.normals[rows]
    rays = fit.stations[:, None] - places
    square = (rays**2).sum(axis=2)
    owner = (np.abs((rays * normals).sum(axis=2)) / np.maximum(square**1.5, 1e-300)).argmax(axis=0)
    taken, lost = fit.stations, np.zeros(len(rows), bool)
    for number, place in enumerate(fit.stations):
        mine = owner == number
        near = square[number].argmin()
        image = taken.copy()
        image[number] = place - 2.0 * (rays[number, near] @ normals[near]) * normals[near]
        views = [hidden(discs, Station(each[number]), rows[mine]) for each in (taken, image)]
        same = min(density.spread(image) for density in densities) <= RIVALS * fit.spread
        turn = same and views[1].sum() < MIRRORED * views[0].sum()
        taken, lost[mine] = (image, views[1]) if turn else (taken, views[0])
    stations = tuple(Station(place) for place in taken)
    return Found(stations, fit.spread, float(lost.mean()), discs)


def _surrounds(discs: Discs, place: Array, n_directions: int, distance: float) -> bool:
    """Tell whether there are discs all around a place.

    Parameters
    ----------
    discs : Discs
        The surface.
    place : (3,) float64
        The place.
    n_directions : int
        Directions that are looked in.
    distance : float
        Largest distance on the unit sphere to the nearest disc.

    Returns
    -------
    bool
    """
    tree = KdTree(Station(place).image(discs.places), thread_count())
    ways = even_directions(n_directions)
    return bool((tree.query(ways, 1, np.inf)[0] <= distance).all())
