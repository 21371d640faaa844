"""Normals by product inference over the nearest rules: twin of ``native/inference.hpp``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .neighbors import query
from .rlps import basis, quadric_height
from .rules import Rules

Array = NDArray[np.float64]


class Contribution(NamedTuple):
    """What the nearest rules say about one place, one row a rule."""

    reach: Array
    """Squared distance in the tangent plane, over the radius."""
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
    centers, frames, coefficients, radius, _, _ = rules
    d = (place - centers) / radius[:, None]
    u, v, h = np.einsum("kad,kd->ak", frames, d)
    reach = u**2 + v**2
    inside = 1.0 / np.sqrt(np.maximum(reach, 1.0))  # no extrapolation beyond the data of the fit
    u, v = u * inside, v * inside
    height = quadric_height(coefficients, u, v)
    for row, local in enumerate(terms or []):
        here = np.array([[u[row], v[row], h[row]]])
        height[row] += (basis(here, local[:, :3]) @ local[:, 3])[0]
    c0, c1, c2, c3, c4, c5 = coefficients.T
    slope_u, slope_v = c1 + 2.0 * c3 * u + c4 * v, c2 + c4 * u + 2.0 * c5 * v
    tilt = 1.0 / np.sqrt(1.0 + slope_u**2 + slope_v**2)
    normal = frames[:, 2] - slope_u[:, None] * frames[:, 0] - slope_v[:, None] * frames[:, 1]
    return Contribution(
        reach=reach,
        residual=(h - height) * tilt * radius,
        normal=normal * tilt[:, None],
        foot=centers + (radius * c0)[:, None] * frames[:, 2],
    )


def infer_normals(rules: Rules, x: Array, k: int) -> tuple[Array, Array]:
    """Infer a normal at every place, eq. (7) with the fuzzy basis functions of eq. (9).

    The membership in a rule is a Gaussian in the tangent plane, half the radius wide, times a
    Gaussian in the residual to the quadric, times the quality.

    Parameters
    ----------
    rules : Rules
        Rules.
    x : (m, 3) float64
        Places.
    k : int
        Nearest rules that take part.

    Returns
    -------
    normals : (m, 3) float64
        Unit normals.
    info : (m, 2) float64
        Agreement of the rules that took part (0 to 1), residual to the best one.
    """
    normals, info = np.zeros((len(x), 3)), np.zeros((len(x), 2))
    for row, index in enumerate(query(rules.centers, x, min(k, len(rules.centers)), np.inf)[1]):
        rule = contributions(x[row], rules.rows(index))
        membership = _log_memberships(rule, rules.rows(index))
        best = int(membership.argmax())
        mean = _shares(membership) @ rule.normal  # Eq. (7)
        agreement = float(np.linalg.norm(mean))
        if agreement < 1e-6:  # the rules cancel: the best one decides
            mean, agreement = rule.normal[best], 1.0
        normals[row] = mean / np.linalg.norm(mean)
        info[row] = min(agreement, 1.0), rule.residual[best]
    return normals, info


def basis_functions(rules: Rules, x: Array, k: int) -> tuple[NDArray[np.int64], Array, Array]:
    """Evaluate the fuzzy basis functions of eq. (9) at every place.

    Parameters
    ----------
    rules, x, k
        As in :func:`infer_normals`.

    Returns
    -------
    index : (m, k) int64
        Nearest rules; 0 where there are fewer than `k`.
    share : (m, k) float64
        Value of their basis functions, a sum of one a row; 0 where there are fewer than `k`.
    height : (m, k) float64
        Signed distance to their quadrics, in the unit of the points.
    """
    nearest = query(rules.centers, x, min(k, len(rules.centers)), np.inf)[1]
    index = np.zeros((len(x), k), np.int64)
    share, height = np.zeros((len(x), k)), np.zeros((len(x), k))
    for row, near in enumerate(nearest):
        rule = contributions(x[row], rules.rows(near))
        index[row, : len(near)] = near
        share[row, : len(near)] = _shares(_log_memberships(rule, rules.rows(near)))
        height[row, : len(near)] = rule.residual
    return index, share, height


def _log_memberships(rule: Contribution, rules: Rules) -> Array:
    z = rule.residual / rules.tolerance
    quality = np.log(np.maximum(rules.quality, 1e-12))
    return np.asarray(-2.0 * rule.reach - 0.5 * z**2 + quality)


def _shares(log_membership: Array) -> Array:
    """Fuzzy basis functions, eq. (9), from logarithms: safe far from every rule."""
    membership = np.exp(log_membership - log_membership.max())
    return np.asarray(membership / membership.sum())
