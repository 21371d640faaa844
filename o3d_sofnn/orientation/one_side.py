"""Stage 5: open surfaces that show only one side to some place or direction, and which side."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.geometry.neighbors import neighborhood_areas
from o3d_sofnn.geometry.vectors import even_directions, unit
from o3d_sofnn.orientation.visibility import DISCS, Discs, Station, hidden
from o3d_sofnn.rules.rule_base import RuleBase
from o3d_sofnn.threads import thread_count

Array = NDArray[np.float64]


ONE_SIDED = 0.13
"""Largest hidden share of an open surface that shows one side to a place. Measured: at most 0.09 on
14 open scans, at least 0.15 on 40 solids from the best direction."""


DIRECTIONS, ASKED = 75, (500, 1000)
"""Number of axes that are tried, and of discs tested for each axis and for the best one."""


GROUND, LOW, SUNK = (0.9, 0.3), 0.7, 0.12
"""Limits for ground seen from above: smallest cosine between z and the normals of level parts, and
smallest level share of the area; largest height, divided by the smaller horizontal extent (standard
deviations); largest mean winding number on the level parts: a larger one indicates an object that
is open below, or a room."""


CONE, AHEAD, DEPTHS, MOVED = 0.7, 0.94, 1.5, 0.2
"""Limits for a cloud in a camera's coordinates: smallest cosine between an axis and its points, and
between an axis and its middle, as seen from the origin; smallest ratio of far to near ranges;
largest hidden share, since the camera may have moved."""


MEAN = 0.01
"""Smallest length of the mean normal: for one-sided surfaces it is at least 0.3, for symmetric
points it is only rounding error."""


ABOVE = Station(np.array([0.0, 0.0, 1.0]), far=True)


@dataclass(frozen=True)
class View:
    """A place or direction to which a surface shows only one side.

    Attributes
    ----------
    kind : str
        "density", "height field", "camera" or "one side".
    station : Station
        The place or direction.
    hidden : float
        Share of the area that is hidden from there.
    """

    kind: str
    station: Station
    hidden: float


def common_view(rules: RuleBase, winding: Array, origin: Array) -> View | None:
    """Find a place or a direction to which an open surface shows only one side.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules of the open surface.
    winding : (r,) float64
        Winding number at the rules.
    origin : (3,) float64
        Origin of the user's coordinates.

    Returns
    -------
    View or None
        None if too much is hidden from everywhere.
    """
    rows = np.linspace(0, len(rules) - 1, min(len(rules), DISCS)).astype(np.int64)
    places = np.ascontiguousarray(rules.feet[rows])
    areas = neighborhood_areas(places, KdTree(places, thread_count()))
    discs = Discs(places, rules.normals[rows], areas, np.sqrt(areas))
    level = np.abs(discs.normals[:, 2]) >= GROUND[0]
    if _is_ground(discs, level, winding[rows]):
        lost = _hidden_share(discs.rows(level), ABOVE, ASKED[1])
        if lost <= ONE_SIDED:
            return View("height field", ABOVE, lost)
    if _is_ahead(discs, origin):
        lost = _hidden_share(discs, Station(origin), ASKED[1])
        if lost <= MOVED:
            return View("camera", Station(origin), lost)
    axes = [Station(axis, far=True) for axis in _axes(discs)]
    best = axes[int(np.argmin([_hidden_share(discs, axis, ASKED[0]) for axis in axes]))]
    lost = _hidden_share(discs, best, ASKED[1])
    if lost > ONE_SIDED:
        return None
    front = discs.areas @ (discs.normals @ best.place) >= 0.0
    return View("one side", Station(best.place if front else -best.place, far=True), lost)


def _hidden_share(discs: Discs, station: Station, asked: int) -> float:
    """Return the share of the area that is hidden from a station."""
    n = len(discs.places)
    rows = np.linspace(0, n - 1, min(n, asked)).astype(np.int64)
    areas = discs.areas[rows]
    return float(areas @ hidden(discs, station, rows) / areas.sum())


def _is_ground(discs: Discs, level: NDArray[np.bool_], winding: Array) -> bool:
    """Return whether much of the surface is level, but neither the top of an object nor a floor."""
    share = discs.areas[level].sum() / discs.areas.sum()
    if share < GROUND[1]:
        return False
    weight = discs.areas / discs.areas.sum()
    extent = np.sqrt(weight @ (discs.places - weight @ discs.places) ** 2)
    sunk = discs.areas[level] @ winding[level] / discs.areas[level].sum()
    return bool(extent[2] <= LOW * extent[:2].min() and abs(sunk) <= SUNK)


def _is_ahead(discs: Discs, origin: Array) -> bool:
    """Return whether everything is in front of a camera at the origin that looks along an axis."""
    rays = discs.places - origin
    ranges = np.linalg.norm(rays, axis=1)
    near, far = np.quantile(ranges, [0.02, 0.98])
    middle = unit(unit(rays).mean(axis=0)[None])[0]
    cone = np.quantile(unit(rays) @ middle, 0.02)
    return bool(cone >= CONE and np.abs(middle).max() >= AHEAD and far >= DEPTHS * near)


def _axes(discs: Discs) -> Array:
    """Return directions over half a sphere, z, and the mean normal if there is one."""
    mean = discs.areas @ discs.normals / discs.areas.sum()
    own = unit(mean[None]) if np.linalg.norm(mean) >= MEAN else np.empty((0, 3))
    return np.vstack([own, ABOVE.place, even_directions(2 * DIRECTIONS)[:DIRECTIONS]])
