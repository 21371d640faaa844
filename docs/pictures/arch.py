"""A lower dental arch as an intraoral scanner sees it: crowns on a ridge of gum, open below."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from paper_parts.dental_shapes import Tooth, incisor, molar
from scipy.spatial import cKDTree

Array = NDArray[Any]

HALF_WIDTH, DEPTH = 26.0, 38.0
"""Of the parabola that the teeth stand on, in mm."""
RADIUS = 6.0
"""Of the ridge, whose upper half is the gum, in mm."""
WIDTHS = {"molar": 11.0, "incisor": 8.3}
"""Room that a crown takes along the arch, in mm."""
RISE = {"molar": 1.0, "incisor": 3.0}
"""Middle of a crown above the gum, in mm."""


def dental_arch(count: int, noise: float = 0.02, seed: int = 0) -> Array:
    """Draw points from a dental arch.

    Parameters
    ----------
    count : int
        Number of points, about.
    noise : float, default 0.02
        Standard deviation of each coordinate, in mm.
    seed : int, default 0
        Of the random numbers.

    Returns
    -------
    numpy.ndarray, shape (n, 3)
        In mm; z is up.
    """
    rng = np.random.default_rng(seed)
    teeth = _places()
    parts = []
    for place, turn, tooth in teeth:
        local = tooth.sample(2 * count // len(teeth), seed=seed)
        parts.append(local @ _about_z(turn).T + place)
    parts.append(_gum(2 * count, rng))
    points = np.concatenate(parts)
    buried = _ridge_distance(points) < RADIUS - 0.05
    for place, turn, tooth in teeth:
        buried |= tooth.implicit((points - place) @ _about_z(turn)) < -0.05
    points = points[~buried & (points[:, 2] > -2.0)]
    points = points[rng.permutation(len(points))[:count]]
    return np.asarray(points + rng.normal(0.0, noise, points.shape))


def _places() -> list[tuple[Array, float, Tooth]]:
    """Place, turn in radians and shape of each crown."""
    shapes = {"molar": molar(), "incisor": incisor()}
    kinds = ["molar"] * 2 + ["incisor"] * 6 + ["molar"] * 2
    widths = [WIDTHS[kind] for kind in kinds]
    curve = _curve(2000)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    middles = 0.5 * (length[-1] - sum(widths)) + np.cumsum(widths) - 0.5 * np.array(widths)
    places = []
    for kind, middle in zip(kinds, middles, strict=True):
        at = int(np.searchsorted(length, middle))
        along = curve[at + 1] - curve[at - 1]
        place = np.array([*curve[at], RADIUS + RISE[kind]])
        places.append((place, float(np.arctan2(along[1], along[0])), shapes[kind]))
    return places


def _curve(count: int) -> Array:
    x = np.linspace(-HALF_WIDTH, HALF_WIDTH, count)
    return np.column_stack([x, DEPTH * (1.0 - (x / HALF_WIDTH) ** 2)])


def _ridge_distance(points: Array) -> Array:
    curve = _curve(4000)
    away, _ = cKDTree(curve).query(points[:, :2])
    return np.asarray(np.hypot(away, points[:, 2]))


def _gum(count: int, rng: np.random.Generator) -> Array:
    curve = _curve(4000)
    step = np.diff(curve, axis=0)
    share = np.linalg.norm(step, axis=1)
    at = rng.choice(len(step), count, p=share / share.sum())
    across = np.column_stack([-step[at, 1], step[at, 0]]) / share[at, None]
    angle = rng.uniform(-0.3, np.pi + 0.3, count)
    flat = curve[at] + rng.random((count, 1)) * step[at] + RADIUS * np.cos(angle)[:, None] * across
    return np.column_stack([flat, RADIUS * np.sin(angle)])


def _about_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
