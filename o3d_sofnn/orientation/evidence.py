"""Stage 5: where the points were seen from, given by the user or found from the points."""

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
"""Cosine above which a normal clearly faces away from a station that was found: smaller ones may be
errors of the normal or of the station. Of 0 to 0.2, tried on synthetic scenes, 0.03 to 0.1 leave
the fewest flipped normals."""


@dataclass(frozen=True)
class Evidence:
    """How the sides of the normals were decided.

    Attributes
    ----------
    kind : str
        "normals", "viewpoint" or "towards" if the user decided; "depth image" or "density" if the
        points reveal where the sensor stood; "height field", "camera" or "one side" if an open
        surface shows one side to a place; "outward" if the winding number alone decides.
    text : str
        The decision in a sentence, with its figures.
    figures : dict of str to float
        What was measured, by name.
    sight : Sight, optional
        Where the points were seen from, in their coordinates.
    sure : bool
        Whether this applies to all points, not only to open surfaces.
    warnings : tuple of str
        Warnings, if the decision is a guess.
    """

    kind: str
    text: str
    figures: dict[str, float] = field(default_factory=dict)
    sight: Sight | None = None
    sure: bool = True
    warnings: tuple[str, ...] = ()

    @property
    def decided(self) -> bool:
        """Whether there is more evidence for the sides than the shape."""
        return self.kind not in ("one side", "outward")

    @property
    def viewpoint(self) -> Array | None:
        """The viewpoint of all points, (3,), or of each, (n, 3), if known."""
        if isinstance(self.sight, Rows):
            return self.sight.places
        if isinstance(self.sight, Station) and not self.sight.far:
            return self.sight.place
        return None

    def directions(self, points: Array) -> Array | None:
        """Return vectors, (n, 3), of any length from points to their viewpoints, if known."""
        return self.sight.directions(points) if self.sight is not None and self.sure else None

    def turned(self, points: Array, normals: Array) -> Array:
        """Flip normals, (n, 3), that clearly face away from the viewpoint of their points.

        If the user gave the viewpoint, all normals that face away from it are flipped.
        """
        directions = self.directions(points)
        if directions is None:
            return normals
        least = 0.0 if self.kind == "viewpoint" else -CLEAR
        away = np.einsum("nd,nd->n", unit(directions), normals) < least
        return np.where(away[:, None], -normals, normals)


def told(normals: Array | None, viewpoint: Array | None, towards: Array | None) -> Evidence | None:
    """Return what the user specified about the sides, or None.

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


def found(points: Array, samples: Samples, frame: Frame) -> Evidence | None:
    """Find out where the sensor stood.

    Parameters
    ----------
    points : (n, 3) float64
        Points in the user's coordinates.
    samples : Samples
        Samples of these points, in the unit cube.
    frame : Frame
        The unit cube.

    Returns
    -------
    Evidence or None
        None if the points do not reveal it.
    """
    if is_depth_image(points):
        text = "sides: every point faces the origin, where the camera of this depth image stood"
        return Evidence("depth image", text, sight=Station(np.zeros(3)))
    stations = find_stations(samples, frame.origin)
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
    return Several(places, frame.outside(discs.places), np.stack(seen))
