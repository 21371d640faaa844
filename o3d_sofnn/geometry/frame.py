"""Transformation between the user's coordinates and the unit cube used for all computations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Frame:
    """The unit cube in the user's coordinates.

    Attributes
    ----------
    middle, extent : (3,) float64 and float
        A point x of the cube is ``extent * x + middle`` in the user's coordinates.
    """

    middle: NDArray[np.float64]
    extent: float

    def outside(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert points of the cube, (..., 3), to the user's coordinates."""
        return np.asarray(self.extent * x + self.middle)

    def inside(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Convert points of the user, (..., 3), to coordinates of the cube."""
        return np.asarray((x - self.middle) / self.extent)

    @property
    def origin(self) -> NDArray[np.float64]:
        """The user's origin, (3,), in coordinates of the cube."""
        return -self.middle / self.extent
