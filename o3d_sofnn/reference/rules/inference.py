"""Normals by product inference over the nearest rules: twin of ``native/rules/inference.hpp``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.reference.implicit.rlps import basis, quadric_height
from o3d_sofnn.reference.rules.rules import Rules
from o3d_sofnn.reference.sampling.local_fit import STEEPEST, arc_over_parabola

Array = NDArray[np.float64]

CONCENTRATION, CLEAN_TOLERANCE = 25.0, 0.02
"""Concentration of the membership in the angle to a side, divided by how much wider the membership
in the residual is than on clean data; both widths are divided by the radius."""


class Contribution(NamedTuple):
    """Contributions of the nearest rules to one query, one row per rule."""

    reach: Array
    """Squared distance in the tangent plane, 1 at the edge of the ellipse."""
    residual: Array
    """Signed distance to the local surface, in the unit of the points."""
    normal: Array
    """Unit normal of the quadric."""
    foot: Array
    """Centre of the rule, moved onto its quadric."""


def contributions(place: Array, rules: Rules, terms: list[Array] | None = None) -> Contribution:
    """Evaluate the consequents of some rules at one place.

    Parameters
    ----------
    place : (3,) float64
        Where.
    rules : Rules
        Rules, k of them.
    terms : list of (t, 4) float64, optional
        Basis functions on top of each quadric; None for the quadrics alone.

    Returns
    -------
    Contribution
    """
    centers, frames, coefficients, radius, stretch = rules[:5]
    d = (place - centers) / radius[:, None]
    u, v, h = np.einsum("kad,kd->ak", frames, d)
    reach = stretch * u**2 + v**2 / stretch
    inside = 1.0 / np.sqrt(np.maximum(reach, 1.0))  # no extrapolation beyond the data of the fit
    u, v = u * inside, v * inside
    height = quadric_height(coefficients, u, v)
    for row, local in enumerate(terms or []):
        here = np.array([[u[row], v[row], h[row]]])
        height[row] += (basis(here, local[:, :3]) @ local[:, 3])[0]
    c0 = coefficients[:, 0]
    slope_u, slope_v = _slopes(coefficients, u, v)
    tilt = 1.0 / np.sqrt(1.0 + slope_u**2 + slope_v**2)
    normal = frames[:, 2] - slope_u[:, None] * frames[:, 0] - slope_v[:, None] * frames[:, 1]
    return Contribution(
        reach=reach,
        residual=(h - height) * tilt * radius,
        normal=normal * tilt[:, None],
        foot=centers + (radius * c0)[:, None] * frames[:, 2],
    )


def _slopes(coefficients: Array, u: Array, v: Array) -> tuple[Array, Array]:
    """Differentiate the height of the consequents by both tangents."""
    _, c1, c2, c3, c4, c5 = coefficients.T
    sq_distance = np.maximum(u**2 + v**2, 1e-30)
    parabola = c3 * u**2 + c4 * u * v + c5 * v**2
    by_u, by_v = 2.0 * c3 * u + c4 * v, c4 * u + 2.0 * c5 * v
    arc = arc_over_parabola(parabola, sq_distance)
    bend = 2.0 * parabola / sq_distance
    steep = bend**2 * sq_distance
    root = np.sqrt(1.0 - np.minimum(steep, STEEPEST))
    more = np.where(steep < STEEPEST, parabola / ((1.0 + root) ** 2 * root), 0.0)
    return (
        c1 + arc * by_u + more * (4.0 * bend * by_u - 2.0 * bend**2 * u),
        c2 + arc * by_v + more * (4.0 * bend * by_v - 2.0 * bend**2 * v),
    )


def infer_normals(
    rules: Rules, x: Array, sides: Array | None, k: int
) -> tuple[Array, Array, Array]:
    """Infer a normal at every place, eq. (7) with the fuzzy basis functions of eq. (9).

    The membership in a rule is a Gaussian in the tangent plane, half the radius wide, times a
    Gaussian in the residual to the quadric, times a bell in the angle to the side (von Mises and
    Fisher), times the quality, times the trust of the off-line rules where there are some.

    Parameters
    ----------
    rules : Rules
        Rules.
    x : (m, 3) float64
        Places.
    sides : (m, 3) float64 or None
        Where their normals face, unit or zero; None for unknown.
    k : int
        Nearest rules that take part; so do those as near as the last of them.

    Returns
    -------
    normals : (m, 3) float64
        Unit normals.
    agreement, residual : (m,) float64
        Agreement of the rules that took part (0 to 1), residual to the best one.
    """
    normals = np.zeros((len(x), 3))
    agreements, residuals = np.zeros((2, len(x)))
    rules = rules.bounded()
    for row, place in enumerate(x):
        side = np.zeros(3) if sides is None else sides[row]
        _, share, rule = _blend(rules, place, side, k)
        best = int(share.argmax())
        mean = share @ rule.normal  # Eq. (7)
        agreement = float(np.linalg.norm(mean))
        if agreement < 1e-6:  # the rules cancel: the best one decides
            mean, agreement = rule.normal[best], 1.0
        normals[row] = mean / np.linalg.norm(mean)
        agreements[row], residuals[row] = min(agreement, 1.0), rule.residual[best]
    return normals, agreements, residuals


def consequent_errors(rules: Rules, x: Array, k: int) -> tuple[Array, Array]:
    """Sum output times fuzzy basis function over some places, for every rule.

    The derivative of half the squared output, eq. (7), with respect to the height of a rule.

    Parameters
    ----------
    rules, x, k
        As in :func:`infer_normals`.

    Returns
    -------
    error : (r,) float64
        Sum of output, in the unit of the points, times basis function.
    share : (r,) float64
        Sum of the basis function, eq. (9).
    """
    error, total = np.zeros(len(rules.centers)), np.zeros(len(rules.centers))
    rules = rules.bounded()
    for place in x:
        near, share, rule = _blend(rules, place, np.zeros(3), k)
        error[near] += share * (share @ rule.residual)  # Eq. (7)
        total[near] += share
    return error, total


def _blend(
    rules: Rules, place: Array, side: Array, k: int
) -> tuple[NDArray[np.int64], Array, Contribution]:
    """Return the nearest rules, their fuzzy basis functions, eq. (9), and what they say."""
    sq_dist = ((rules.centers - place) ** 2).sum(axis=1)
    near = np.flatnonzero(sq_dist <= np.sort(sq_dist)[min(k, len(sq_dist)) - 1])
    membership, rule = log_memberships(rules.rows(near), place, side)
    share = np.exp(membership - membership.max())  # safe far from every rule
    return near, np.asarray(share / share.sum()), rule


def log_memberships(rules: Rules, place: Array, side: Array) -> tuple[Array, Contribution]:
    """Logarithm of the membership of one place in some rules, (k,), and what they say.

    Parameters
    ----------
    rules : Rules
        Rules, k of them.
    place, side : (3,) float64
        Where, and where the normal faces: unit, or zero where unknown.
    """
    rule = contributions(place, rules)
    z = rule.residual / rules.tolerance
    membership = np.log(np.maximum(rules.quality, 1e-12)) - 2.0 * rule.reach - 0.5 * z**2
    wide = np.maximum(rules.tolerance / rules.radius - CLEAN_TOLERANCE, 0.0)
    lean = rule.normal @ side
    # An unknown side is no reason for mistrust.
    trust = rules.trust(rule.residual / rules.radius, lean + 1.0 - side @ side, rule.reach)
    return membership + CONCENTRATION * wide * lean + trust, rule
