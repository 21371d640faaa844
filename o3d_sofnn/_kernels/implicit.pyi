"""Algorithm 2 and the field."""

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels.geometry import KdTree
from o3d_sofnn._kernels.rules import RuleView

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]

def reconstruct_units(
    tree: KdTree,
    points: _Floats,
    normals: _Floats,
    rules: RuleView,
    n_neighbors: _Ints,
    n_own: _Ints,
    tolerance: _Floats,
) -> tuple[_Floats, _Ints, _Floats, _Floats]:
    """Refine the quadric of every rule until its points are met, Algorithm 2.

    `tree` is over `points`, `tolerance` (r,) is the precision, `n_own` of the `n_neighbors` points
    of a unit decide whether it is refined. Returns basis functions (r, t, 4) as centre and weight,
    the number of them in use (r,), the largest residual left (r,), and where it is (r, 3).
    """

def evaluate_field(rules: RuleView, rbf: _Floats, terms: _Ints, x: _Floats, k: int) -> _Floats:
    """Signed distance (m,) at every row of `x`, blended from the `k` nearest rules, eq. (9).

    `rbf` and `terms` come from :func:`reconstruct_units`.
    """
