"""The rules that twins infer from: twin of the class ``RuleView`` of ``native/inference.hpp``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Rules(NamedTuple):
    """The arrays of a rule base, one row a rule."""

    centers: Array
    """Centres, (r, 3)."""
    frames: Array
    """Two tangents and the normal, (r, 3, 3)."""
    coefficients: Array
    """Quadrics, lengths over the radius, (r, 6)."""
    radius: Array
    """Radii of the fits, in the unit of the points, (r,)."""
    stretch: Array
    """How many times longer than wide the neighbourhoods are, (r,)."""
    tolerance: Array
    """Width of the Gaussian in the residual, in the unit of the points, (r,)."""
    quality: Array
    """Weight of each rule, 0 to 1, (r,)."""

    def rows(self, index: NDArray[np.int64]) -> Rules:
        """Pick the rules of these numbers."""
        return Rules(*(array[index] for array in self))
