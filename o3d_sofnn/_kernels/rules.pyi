"""Rule bases and what they infer."""

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]

class RuleView:
    """The arrays of a rule base, copied, and a tree over its centres.

    Parameters
    ----------
    centers : (r, 3) float64
    frames : (r, 3, 3) float64
    coefficients : (r, 6) float64
    radius, stretch, tolerance, quality : (r,) float64
    gates : (r, m, 2) float64 or None
        Share of each rule in at most 8 neurons of the off-line rules: logarithm of the firing
        strength and consequent, as far as the inputs belong to the rule.
    neurons : (m, 3, 3) float64 or None
        Centres, inverse widths and slopes by the inputs that belong to the place.
    n_threads : int
    """

    def __init__(
        self,
        centers: _Floats,
        frames: _Floats,
        coefficients: _Floats,
        radius: _Floats,
        stretch: _Floats,
        tolerance: _Floats,
        quality: _Floats,
        gates: _Floats | None,
        neurons: _Floats | None,
        n_threads: int,
    ) -> None: ...
    @property
    def size(self) -> int:
        """Number of rules."""

def infer_normals(
    rules: RuleView, x: _Floats, sides: _Floats | None, k: int
) -> tuple[_Floats, _Floats, _Floats]:
    """Infer a normal at every row of `x` from the `k` nearest rules, eq. (7) and (9).

    Rules that face the way of `sides` (m, 3), unit vectors or zero, have a larger share. Returns
    unit normals (m, 3), agreement of the rules (m,) and residual to the best one (m,). Fastest
    where consecutive places lie close together.
    """

def consequent_errors(rules: RuleView, x: _Floats, k: int) -> tuple[_Floats, _Floats]:
    """Sum output, eq. (7), times fuzzy basis function, eq. (9), of each rule over `x` (m, 3).

    Only the `k` nearest rules of a place take part. Returns that sum and that of the basis
    functions alone, (r,) each.
    """
