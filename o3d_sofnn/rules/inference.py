"""Stage 4: inference of normals from the rules around a query."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import infer_normals as native_infer_normals
from o3d_sofnn.rules.rule_base import RuleBase
from o3d_sofnn.rules.trust import Experience

NEAREST = 12
"""Number of rules that take part in the inference at one query."""


def infer_normals(
    rules: RuleBase,
    x: NDArray[np.float64],
    *,
    sides: NDArray[np.float64] | None = None,
    k: int = NEAREST,
    experience: Experience | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Infer a normal at every point, eq. (7) and (9).

    The membership of a point in a rule is the product of a Gaussian in the tangent plane, a
    Gaussian in the residual to the quadric, and the rule's quality, so that a point takes its
    normal from the face of an edge or the side of a sheet it lies on.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    x : (n, 3) float64
        Queries.
    sides : (n, 3) float64, optional
        Unit vectors that point out of the surface at each query; (0, 0, 0) where unknown. The
        membership then includes a Gaussian in the angle to the normal of the rule: on parts hardly
        thicker than the noise, the residual alone does not distinguish the sides.
    k : int, default 12
        Number of nearest rules that take part.
    experience : Experience, optional
        Off-line rules: their trust in a rule at a query becomes a factor of the membership.

    Returns
    -------
    normals : (n, 3) float64
        Unit normals.
    agreement : (n,) float64
        Length of the mean normal of the rules that took part, 0 to 1.
    residual : (n,) float64
        Signed distance to the quadric of the rule with the largest membership.
    """
    view = rules.plain_view
    if experience is not None:
        view = rules.view(experience.gates(rules), experience.neurons)
    normals, agreement, residual = native_infer_normals(view, x, sides, min(k, len(rules)))
    return np.asarray(normals), np.asarray(agreement), np.asarray(residual)
