"""Stage 5: where scanners stood, found from the density of the points."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.orientation.density import Density, Fit, spread_of
from o3d_sofnn.orientation.visibility import DISCS, Discs, Station, hidden
from o3d_sofnn.sampling.outliers import Samples

Array = NDArray[np.float64]


ASKED = 1500
"""Discs whose density is looked at, and whose view."""


UNEVEN = 0.2, 0.7
"""Spread of the logarithm of the area per point from which on a station is looked for, and several
together: with less there is too little to explain."""


EXPLAINED, WELL = (0.45, 0.4), 0.15
"""Largest share of that spread that one station leaves, and that several leave; with less than the
last no further station is looked for."""


FEWER = 2.0
"""Spread up to which fewer stations are taken, over that of more."""


FAR = 10.0
"""Distance, over the size of the scene, from which on the density does not tell the station from
one on the other side."""


HIDDEN = 0.2, 0.1
"""Largest share of the surface that one station does not see, and that none of several sees."""


RIVALS, APART, MOST = 1.3, 0.02, 4
"""Spread that other places leave, over that of the best, up to which they are rivals: the one that
sees most is taken. Nearer than this, over the size of the scene, two places are one. So many are
looked at, at most."""


ALIKE = 0.05
"""Difference in what they hide up to which the better fit of two rivals is taken."""


MIRRORED = 0.3
"""What the mirror image of a station, on the other side of the surface nearest to it, does not see,
over what the station does not, up to which it is taken instead."""


CENTRAL = 0.05
"""Distance from the centre of the area, over the size of the scene, within which nobody stands:
objects whose points were drawn around their centre are as dense as a room seen from there."""


ORIGIN = 1.15
"""Spread that the origin of the coordinates leaves, over that of the best place, up to which it is
as good: most sensors have their origin in themselves."""


SEVERAL = 3
"""Most stations that are looked for together."""


@dataclass(frozen=True)
class Found:
    """Stations that explain the density.

    Attributes
    ----------
    stations : tuple of Station
        One to three places.
    left : float
        Spread of the density that they leave, over the one there is.
    hidden : float
        Share of the discs that none of them sees.
    discs : Discs
        The surface.
    """

    stations: tuple[Station, ...]
    left: float
    hidden: float
    discs: Discs


def find_stations(samples: Samples, origin: Array, n_threads: int) -> Found | None:
    """Find the places from which the density of the points is what a scanner makes of it.

    A scanner sends its rays out evenly: the area that one point covers, times the cosine of
    incidence, over the square of the range, is the same everywhere. Where several stood their
    densities add up. The places where the logarithm of that spreads least are found from many
    starts by Gauss-Newton steps. Of a closed object no place outside sees all, and none inside
    explains the density, whatever the sampling.

    Parameters
    ----------
    samples : Samples
        The points.
    origin : (3,) float64
        Origin of the user's coordinates, in those of the samples.
    n_threads : int
        Threads.

    Returns
    -------
    Found or None
        None where the density is even, or no station explains it and sees the surface.
    """
    some = Discs.of(samples, ASKED, n_threads)
    raw = spread_of(np.log(some.areas))
    if raw < UNEVEN[0]:
        return None
    densities = [Density.of(some, turning) for turning in (False, True)]
    discs: Discs | None = None
    found: list[Found] = []
    fits: list[Fit] = []
    for count in range(1, SEVERAL + 1 if raw > UNEVEN[1] else 2):
        fits = [fit for density in densities for fit in density.fits(count, fits)]
        if count == 1:
            home = origin[None]
            fits.append(Fit(home, min(density.spread(home) for density in densities) / ORIGIN))
        fits.sort(key=lambda fit: fit.spread)
        several = int(count > 1)
        if fits[0].spread > EXPLAINED[several] * raw:
            continue
        discs = discs or Discs.of(samples, DISCS, n_threads)
        best = _most_seen(fits, densities, discs)
        if best and best.hidden <= HIDDEN[several] and not _is_central(best, densities[0].size):
            found.append(replace(best, left=best.left / raw))
        if found and found[-1].left < WELL:
            break
    least = min((each.left for each in found), default=0.0)
    return next((each for each in found if each.left <= FEWER * least), None)


def _is_central(found: Found, size: float) -> bool:
    """Whether the first station stands in the centre of the surface."""
    discs = found.discs
    centre = discs.areas @ discs.places / discs.areas.sum()
    return bool(np.linalg.norm(found.stations[0].place - centre) < CENTRAL * size)


def _most_seen(fits: list[Fit], densities: list[Density], discs: Discs) -> Found | None:
    """Of the stations that explain the density about as well as the best, those that see most."""
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
    """Judge each station by the discs that owe it most, or else its image below the ground.

    The mirror image of a station on the other side of a flat ground makes the same of its density.
    """
    rows = np.linspace(0, len(discs.places) - 1, min(ASKED, len(discs.places))).astype(np.int64)
    places, normals = discs.places[rows], discs.normals[rows]
    rays = fit.stations[:, None] - places
    square = (rays**2).sum(axis=2)
    owner = (np.abs((rays * normals).sum(axis=2)) / square**1.5).argmax(axis=0)
    taken, lost = fit.stations, 0.0
    for number, place in enumerate(fit.stations):
        mine = rows[owner == number]
        near = square[number].argmin()
        image = taken.copy()
        image[number] = place + 2.0 * (rays[number, near] @ normals[near]) * -normals[near]
        unseen = [hidden(discs, Station(each[number]), mine).sum() for each in (taken, image)]
        same = min(density.spread(image) for density in densities) <= RIVALS * fit.spread
        if same and unseen[1] < MIRRORED * unseen[0]:
            taken, unseen = image, unseen[::-1]
        lost += unseen[0]
    return Found(tuple(Station(place) for place in taken), fit.spread, lost / len(rows), discs)
