"""Colours for directions and for errors."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

HEAT = ((214, 222, 233), (252, 204, 115), (230, 84, 51), (115, 0, 26))
"""Colours of errors, evenly spaced from 0 to the largest."""
FLIPPED = (0.80, 0.05, 0.10)
"""Colour of points whose normals point to the wrong side."""
RIGHT = (0.70, 0.74, 0.80)
"""Colour of the other points."""


def direction_colors(normals: Array) -> Array:
    """Colour (n, 3) unit vectors by their direction: x red, y green, z blue."""
    return 0.5 + 0.5 * np.asarray(normals)


def heat_colors(values: Array, largest: float) -> Array:
    """Colour (n,) numbers from 0 (pale) to ``largest`` and beyond (dark red)."""
    share = np.clip(np.asarray(values) / largest, 0.0, 1.0)
    stops = np.array(HEAT) / 255.0
    place = np.linspace(0.0, 1.0, len(stops))
    return np.stack([np.interp(share, place, stops[:, k]) for k in range(3)], axis=1)


def side_colors(flipped: Array) -> Array:
    """Colour flipped points, (n,) bool, red and the others grey."""
    return np.where(np.asarray(flipped, bool)[:, None], FLIPPED, RIGHT)
