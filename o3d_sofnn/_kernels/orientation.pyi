"""Winding numbers."""

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]

class WindingLists:
    """Places, and what a tree sums there."""

class WindingTree:
    """Tree over sources (n, 3); `area` (n,) is their share in the centres of its nodes.

    Sums are single precision, relative to the mean of the points; a smoothing width is taken as at
    least 2**-26 of their largest distance from it.
    """

    def __init__(self, points: _Floats, area: _Floats, n_threads: int = 1) -> None: ...
    def order(self) -> _Ints:
        """Order (n,) in which consecutive points lie close together."""

    def winding(self, mu: _Floats, x: _Floats, width: _Floats, theta: float) -> _Floats:
        """Winding number (m,) at every row of `x` of dipoles `mu` (n, 3), smoothed over `width`.

        A node that looks smaller than the opening angle `theta` is summed at its centre;
        consecutive places share that decision.
        """

    def gradient(
        self, mu: _Floats, x: _Floats, width: _Floats, theta: float
    ) -> tuple[_Floats, _Floats]:
        """Winding number (m,) and its downhill gradient (m, 3); arguments as above."""

    def lists(self, x: _Floats, theta: float) -> WindingLists:
        """Find what is summed at every row of `x`, for many sums at the same places."""

    def winding_at(self, mu: _Floats, lists: WindingLists, width: _Floats) -> _Floats:
        """Sum as `winding` at the places of `lists`."""

    def gradient_at(
        self, mu: _Floats, lists: WindingLists, width: _Floats
    ) -> tuple[_Floats, _Floats]:
        """Sum as `gradient` at the places of `lists`."""

    def adjoint_at(self, charge: _Floats, lists: WindingLists, width: _Floats) -> _Floats:
        """Sum as `adjoint` at the places of `lists`."""
