"""Winding number of the rules in front of them and behind them: what is closed, and how surely."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, WindingTree
from o3d_sofnn.geometry.neighbors import neighborhood_areas
from o3d_sofnn.orientation.components import pieces
from o3d_sofnn.orientation.winding_normals import OPENING
from o3d_sofnn.rules.rule_base import RuleBase

PREFERENCE = 0.05
"""Mean winding number on a piece below which neither of its sides is the outer one: 1/2 on a closed
surface, 0 on a plane."""


SHEET = 9
"""Rules from which on a piece may be a sheet: what the winding number of fewer says is chance."""


CLOSED = 0.82
"""Share of a piece with nothing in front of it from which on it counts as closed."""


def certainty(rules: RuleBase, settled: bool, n_threads: int) -> NDArray[np.float64]:
    """How far the winding number falls from one spacing behind each rule to one in front of it.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    settled : bool
        The user has said which side is which.
    n_threads : int
        Number of threads.

    Returns
    -------
    (r,) float64
        1 where both sides are clear, less on parts thinner than two spacings and where neighbours
        disagree, 0 where the rule faces against what surrounds it and, unless `settled`, where
        its side is a toss of a coin.
    """
    front, behind, on = winding_before(rules, (1.0, -1.0, 0.0), n_threads)
    sure = np.clip(behind - front, 0.0, 1.0)
    return sure if settled else np.where(_balanced(rules, on, n_threads), 0.0, sure)


def undecided(rules: RuleBase, n_threads: int) -> NDArray[np.bool_]:
    """Whether the side of the piece that each rule belongs to is a toss of a coin.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    n_threads : int
        Number of threads.

    Returns
    -------
    (r,) bool
        True where the winding number is as often above as below zero on the piece.
    """
    return _balanced(rules, winding_before(rules, (0.0,), n_threads)[0], n_threads)


def _balanced(rules: RuleBase, winding: NDArray[np.float64], n_threads: int) -> NDArray[np.bool_]:
    """Whether the winding number on the piece that each rule belongs to is zero in the mean."""
    piece = pieces(rules, n_threads)
    level = np.bincount(piece, rules.areas * winding)
    balanced = np.abs(level) < PREFERENCE * np.bincount(piece, rules.areas)
    return np.asarray((balanced & (np.bincount(piece) >= SHEET))[piece])


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
        Number of threads.

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
        Number of threads.

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
