"""Winding number of the rules in front of them and behind them: what is closed, and how surely."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ._kernels import KdTree, WindingTree
from .rule_base import RuleBase
from .winding import neighborhood_areas
from .winding_normals import OPENING

SMOOTH = 0.7
"""Smoothing width of the winding number of rules, over their spacing."""
AROUND = 16
"""Rules whose median says how far apart they are at a place: closer to sparse ones than their
spacing the winding number says nothing of sides."""


def empty_in_front(rules: RuleBase, n_threads: int) -> NDArray[np.bool_]:
    """Whether the winding number one spacing in front of each rule is that of the outside.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    n_threads : int
        Threads.

    Returns
    -------
    (r,) bool
        True nearly everywhere on a closed surface, on less than half of an open one.
    """
    return np.asarray(np.abs(winding_before(rules, (1.0,), n_threads)[0]) < 0.25)


def winding_before(
    rules: RuleBase, steps: tuple[float, ...], n_threads: int
) -> list[NDArray[np.float64]]:
    """Winding number of the rules so many spacings in front of each of them.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    steps : tuple of float
        Steps along the normals, over the spacing of the rules around each of them.
    n_threads : int
        Threads.

    Returns
    -------
    list of (r,) float64
        One for each step.
    """
    feet, normals = rules.feet, rules.normals
    index = KdTree(feet, n_threads)
    area = neighborhood_areas(feet, index, n_threads)
    near = index.query(feet, min(AROUND, len(feet)), np.inf, n_threads)[1]
    spacing = np.sqrt(np.median(area[near], axis=1))
    tree = WindingTree(feet, area)
    mu = area[:, None] * normals
    places = [np.ascontiguousarray(feet + step * spacing[:, None] * normals) for step in steps]
    return [np.asarray(tree.winding(mu, x, SMOOTH * spacing, OPENING, n_threads)) for x in places]
