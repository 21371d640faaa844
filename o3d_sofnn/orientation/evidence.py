"""Stage 5: where the points were seen from: told by the user, or found in the points."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.geometry.frame import Frame
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.orientation.lattice import is_depth_image
from o3d_sofnn.orientation.station import Found, find_stations
from o3d_sofnn.orientation.visibility import Rows, Several, Sight, Station, hidden

if TYPE_CHECKING:
    from o3d_sofnn.sampling.outliers import Samples

Array = NDArray[np.float64]


CLEAR = 0.03
"""Cosine from which on a normal clearly faces away from a station that was found: less is the error
of the normal or of the station (none to 0.2 tried on made scenes: 0.03 to 0.1 flip least)."""


@dataclass(frozen=True)
class Evidence:
    """What the sides of the normals were decided by.

    Attributes
    ----------
    kind : str
        "normals", "viewpoint" or "towards" where the user has told; "depth image" or "density"
        where the points tell where the sensor stood; "height field", "camera" or "one side" where
        an open surface shows one side to a place; "outward" where the winding number alone decides.
    text : str
        The decision in a sentence, with its figures.
    figures : dict of str to float
        What was measured, by name.
    sight : Sight, optional
        From where the points were seen, in their coordinates.
    sure : bool
        Whether that holds for all points, and not for open surfaces only.
    warnings : tuple of str
        Said where the decision is a guess.
    """

    kind: str
    text: str
    figures: dict[str, float] = field(default_factory=dict)
    sight: Sight | None = None
    sure: bool = True
    warnings: tuple[str, ...] = ()

    @property
    def decided(self) -> bool:
        """Whether more than the shape speaks for the sides."""
        return self.kind not in ("one side", "outward")

    @property
    def viewpoint(self) -> Array | None:
        """Place, (3,), that all points were seen from, or one for each, (n, 3), if known."""
        if isinstance(self.sight, Rows):
            return self.sight.places
        if isinstance(self.sight, Station) and not self.sight.far:
            return self.sight.place
        return None

    def directions(self, points: Array) -> Array | None:
        """Vectors, (n, 3), of any length from points to where they were seen from, if known."""
        return self.sight.directions(points) if self.sight is not None and self.sure else None

    def turned(self, points: Array, normals: Array) -> Array:
        """Turn normals, (n, 3), that clearly face away from where their points were seen.

        A viewpoint that the user has given is obeyed to the letter.
        """
        directions = self.directions(points)
        if directions is None:
            return normals
        least = 0.0 if self.kind == "viewpoint" else -CLEAR
        away = np.einsum("nd,nd->n", unit(directions), normals) < least
        return np.where(away[:, None], -normals, normals)


def told(normals: Array | None, viewpoint: Array | None, towards: Array | None) -> Evidence | None:
    """Return what the user has said of the sides, None for nothing.

    Parameters
    ----------
    normals : (n, 3) float64 or None
        Known normals.
    viewpoint : (3,) or (n, 3) float64 or None
        Where all points, or each of them, were seen from.
    towards : (3,) float64 or None
        Direction to a viewer who is far away.
    """
    if normals is not None:
        return Evidence("normals", "sides: as the given normals have them")
    if viewpoint is not None:
        many = viewpoint.ndim == 2
        sight: Sight = Rows(viewpoint) if many else Station(viewpoint)
        places = "their given viewpoints" if many else "the given viewpoint"
        return Evidence("viewpoint", f"sides: every point faces {places}", sight=sight)
    if towards is not None:
        text = "sides: every point faces the given direction"
        return Evidence("towards", text, sight=Station(towards, far=True))
    return None


def found(points: Array, samples: Samples, frame: Frame, n_threads: int) -> Evidence | None:
    """Find out where the sensor stood.

    Parameters
    ----------
    points : (n, 3) float64
        In the user's coordinates.
    samples : Samples
        Of them, in the unit cube.
    frame : Frame
        That cube.
    n_threads : int
        Number of threads.

    Returns
    -------
    Evidence or None
        None where the points do not tell.
    """
    if is_depth_image(points):
        text = "sides: every point faces the origin, where the camera of this depth image stood"
        return Evidence("depth image", text, sight=Station(np.zeros(3)))
    stations = find_stations(samples, frame.origin, n_threads)
    if stations is None:
        return None
    places = frame.outside(np.stack([station.place for station in stations.stations]))
    named = " and ".join("(" + ", ".join(f"{x:.4g}" for x in place) + ")" for place in places)
    text = (
        f"sides: every point faces the scanner; from {named} it sees "
        f"{100.0 * (1.0 - stations.hidden):.0f} % of the surface and explains the density but "
        f"for {100.0 * stations.left:.0f} % of its spread"
    )
    figures = {"left": stations.left, "hidden": stations.hidden}
    return Evidence("density", text, figures, _sight(stations, places, frame), stations.sure)


def _sight(stations: Found, places: Array, frame: Frame) -> Sight:
    if len(places) == 1:
        return Station(places[0])
    discs = stations.discs
    every = np.arange(len(discs.places))
    seen = [~hidden(discs, station, every) for station in stations.stations]
    return Several(places, frame.outside(discs.places), np.stack(seen), discs.n_threads)
