"""Trees and orders of points."""

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]

class KdTree:
    """Tree over points (n, 3), which are copied.

    Parameters
    ----------
    points : (n, 3) float64
    n_threads : int
    """

    def __init__(self, points: _Floats, n_threads: int) -> None: ...
    @property
    def size(self) -> int:
        """Number of points."""

    def query(self, x: _Floats, k: int, max_distance: float) -> tuple[_Floats, _Ints]:
        """Find the `k` nearest points of every row of `x` within `max_distance`.

        Returns distances and indices, (m, k) each, nearest first, of equally near ones the smaller
        index first. Infinity and ``size`` fill rows with fewer neighbours.
        """

    def crowded(self, x: _Floats, k: int, distance: _Floats) -> NDArray[np.uint8]:
        """Whether (1 or 0) each row of `x` has at least `k` points within its `distance` (m,)."""

def sort_morton(points: _Floats, n_threads: int) -> tuple[NDArray[np.uint64], _Ints]:
    """Sort points (n, 3) along the Morton curve, 21 bits an axis.

    Returns ascending keys (n,) and the row (n,) that each comes from, of equal keys the smaller row
    first.
    """
