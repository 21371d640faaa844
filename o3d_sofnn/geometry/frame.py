"""Coordinates of the user, and those of the unit cube in which everything is computed."""

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
        A place x of the cube is ``extent * x + middle`` to the user.
    """

    middle: NDArray[np.float64]
    extent: float

    def outside(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places of the cube, (..., 3), in the user's coordinates."""
        return np.asarray(self.extent * x + self.middle)

    def inside(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places of the user, (..., 3), in coordinates of the cube."""
        return np.asarray((x - self.middle) / self.extent)

    @property
    def origin(self) -> NDArray[np.float64]:
        """The user's origin, (3,), in coordinates of the cube."""
        return -self.middle / self.extent
