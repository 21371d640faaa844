"""Winding number in front of and behind the rules: which parts are closed, and how certainly."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import WindingTree
from o3d_sofnn.geometry.neighbors import neighborhood_areas
from o3d_sofnn.orientation.components import pieces
from o3d_sofnn.orientation.winding_normals import OPENING
from o3d_sofnn.rules.rule_base import RuleBase

PREFERENCE = 0.05
"""Mean winding number on a component below which neither of its sides is the outer one. It is 1/2
on a closed surface and 0 on a plane."""


SHEET = 9
"""Smallest number of rules in a sheet: the winding number of fewer rules is random."""


CLOSED = 0.82
"""Share of a component with nothing in front of it above which it counts as closed."""


def certainty(rules: RuleBase, settled: bool) -> NDArray[np.float64]:
    """Return how far the winding number falls from behind each rule to its front.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    settled : bool
        Whether the user decided the sides.

    Returns
    -------
    (r,) float64
        The fall from one spacing behind to one spacing in front: 1 where both sides are clear, less
        on parts thinner than two spacings and where neighbours disagree, 0 where the rule faces the
        opposite way to its surroundings and, unless `settled`, where its side is arbitrary.
    """
    front, behind, on = winding_before(rules, (1.0, -1.0, 0.0))
    sure = np.clip(behind - front, 0.0, 1.0)
    return sure if settled else np.where(_balanced(rules, on), 0.0, sure)


def undecided(rules: RuleBase) -> NDArray[np.bool_]:
    """Mark rules on connected components that have no outer side.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.

    Returns
    -------
    (r,) bool
        True where the winding number on the component is as often above zero as below.
    """
    return _balanced(rules, winding_before(rules, (0.0,))[0])


def _balanced(rules: RuleBase, winding: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mark rules on components whose mean winding number is zero."""
    piece = pieces(rules)
    level = np.bincount(piece, rules.areas * winding)
    balanced = np.abs(level) < PREFERENCE * np.bincount(piece, rules.areas)
    return np.asarray((balanced & (np.bincount(piece) >= SHEET))[piece])


SMOOTH = 0.7
"""Smoothing width of the winding number of rules, divided by their spacing."""


AROUND = 16
"""Number of rules whose median gives the local spacing of rules: closer to sparse rules than their
spacing, the winding number is no evidence of sides."""


def empty_in_front(rules: RuleBase) -> NDArray[np.bool_]:
    """Mark rules with the winding number of the outside one spacing in front of them.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.

    Returns
    -------
    (r,) bool
        True nearly everywhere on a closed surface, and on less than half of an open one.
    """
    return np.asarray(np.abs(winding_before(rules, (1.0,))[0]) < 0.25)


RIM, GAP = 0.2, 2.0 * np.pi / 3.0
"""Share of a component at its border above which it is open, whatever is in front of it: 0.37 for a
facade whose normals face away from the scene, at most 0.05 for shapes and teeth; and the angle
without neighbours that makes a rule one of the border."""


def at_border(rules: RuleBase) -> NDArray[np.bool_]:
    """Mark rules whose neighbours, seen along the normal, leave a wide angle free.

    Parameters
    ----------
    rules : RuleBase
        Rules; their sides do not matter.

    Returns
    -------
    (r,) bool
        True along the border of a surface (Bendels et al. 2006, the angle criterion).
    """
    feet = rules.feet
    near = rules.foot_tree.query(feet, min(AROUND + 1, len(feet)), np.inf)[1][:, 1:]
    along = np.einsum("rkd,red->erk", feet[near] - feet[:, None], rules.frames[:, :2])
    angle = np.sort(np.arctan2(along[1], along[0]), axis=1)
    free = np.diff(angle, axis=1, append=angle[:, :1] + 2.0 * np.pi)
    return np.asarray(free.max(axis=1, initial=0.0) > GAP)


def winding_before(rules: RuleBase, steps: tuple[float, ...]) -> list[NDArray[np.float64]]:
    """Evaluate the winding number of the rules in front of each of them.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    steps : tuple of float
        Distances along the normals, in units of the spacing of the surrounding rules.

    Returns
    -------
    list of (r,) float64
        Winding numbers, one array per step.
    """
    feet, normals = rules.feet, rules.normals
    index = rules.foot_tree
    area = neighborhood_areas(feet, index)
    near = index.query(feet, min(AROUND, len(feet)), np.inf)[1]
    spacing = np.sqrt(np.median(area[near], axis=1))
    tree = WindingTree(feet, area)
    mu = area[:, None] * normals
    places = [np.ascontiguousarray(feet + step * spacing[:, None] * normals) for step in steps]
    return [np.asarray(tree.winding(mu, x, SMOOTH * spacing, OPENING)) for x in places]
