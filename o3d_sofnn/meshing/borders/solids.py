"""Parts of the data that lie on solids according to the winding number."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.orientation.components import pieces
from o3d_sofnn.orientation.confidence import CLOSED, SHEET, winding_before
from o3d_sofnn.rules.rule_base import RuleBase
from o3d_sofnn.threads import thread_count

WOUND = 0.25
"""Smallest mean winding number on a component of the rule base that may be a solid: 0.27 to 0.6 on
thin and thick closed ones, at most 0.23 on sheets and small patches (25 scans, 20 shapes)."""


BESIDE = 3.0
"""Distance from a rule, divided by its radius, up to which a point is in the same component."""


Array = NDArray[np.float64]


def solids(rules: RuleBase, samples: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Mark the rules and samples on solids, according to the winding number.

    Nearly everywhere in front of a solid, the space is empty, and the winding number on its surface
    is about one half. The same holds for half a sphere, which is recognised later by its rim. A few
    isolated rules may look like a solid by chance: they follow a larger component that contains
    them.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    samples : (n, 3) float64
        Points on the surface.

    Returns
    -------
    of_rules, of_samples : (r,) and (n,) bool
    """
    front, on = winding_before(rules, (1.0, 0.0))
    piece = pieces(rules)
    area = np.bincount(piece, rules.areas)
    empty = np.bincount(piece, rules.areas * (np.abs(front) < 0.25))
    solid = (empty >= CLOSED * area) & (np.bincount(piece, rules.areas * on) >= WOUND * area)
    count = np.bincount(piece)
    large = np.flatnonzero((count >= min(SHEET, int(count.max())))[piece])
    tree = KdTree(np.ascontiguousarray(rules.centers[large]), thread_count())
    of_large, radius = solid[piece[large]], rules.radius[large]

    def of(x: Array) -> NDArray[np.bool_]:
        distance, index = tree.query(x, 1, np.inf)
        return np.asarray(of_large[index[:, 0]] & (distance[:, 0] <= BESIDE * radius[index[:, 0]]))

    return of(rules.centers), of(samples)
