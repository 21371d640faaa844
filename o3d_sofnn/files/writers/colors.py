"""Conversion of colours to the integer levels of formats."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from o3d_sofnn.adapters import CloudArrays


_COLOR_LEVELS = {"b": 1.0, "u1": 255.0, "u2": 65535.0}


def color_levels(cloud: CloudArrays, kind: str) -> NDArray[Any] | None:
    """Return the colours as whole levels of ``kind`` ("u1" or "u2"), or None without colours.

    Colours in floating point are fractions of full intensity; integers are levels of their type.
    """
    colors = cloud.attributes.get("colors")
    if colors is None:
        return None
    stored = colors.dtype.str[1:]
    if stored == kind:
        return colors
    shares = colors / _COLOR_LEVELS.get(stored, 1.0)
    full = _COLOR_LEVELS[kind]
    levels: NDArray[Any] = np.rint(np.nan_to_num(shares).clip(0.0, 1.0) * full).astype(kind)
    return levels
