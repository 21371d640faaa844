"""Radial basis functions on top of the quadric of a rule: twin of ``native/implicit/rlps.hpp``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.reference.geometry.neighbors import query
from o3d_sofnn.reference.rules.rules import Rules
from o3d_sofnn.reference.sampling.local_fit import arc_over_parabola

Array = NDArray[np.float64]

CENTERS = 12
"""Most centres of a unit, delta of Algorithm 2."""
SAME_SIDE = 0.5
"""Smallest cosine between the normals of a unit and of its points."""
BOUND_REACH, BOUND_COUNT = 1.25, 3
"""Limits for points of other faces that bound a unit: distance up to which its function is used,
divided by its radius, and number, divided by the number of its points."""
APART = 0.2
"""Smallest distance of the centre of a unit from the tangent plane of such a point, divided by
their distance, so that it certainly lies behind or in front of that face."""
SUPPORT = 1.0
"""Support of the basis functions, divided by the radius of the unit."""
RIDGE = 1e-6
"""Added to the diagonal of the system, against centres on top of each other."""


class UnitPoints(NamedTuple):
    """Points of a unit, in the frame of its rule and divided by its radius."""

    local: Array
    """Coordinates, (m, 3)."""
    bound: NDArray[np.int64]
    """0 on the surface; 1 or -1 on another face: the surface may not pass below or above."""
    own: NDArray[np.bool_]
    """Whether a point decides if the unit is refined."""


class LocalSurface(NamedTuple):
    """Result of :func:`reconstruct_unit`, in the frame of the rule and divided by its radius."""

    terms: Array
    error: float
    worst: Array


def reconstruct_units(
    points: Array,
    normals: Array,
    rules: Rules,
    n_neighbors: NDArray[np.int64],
    n_own: NDArray[np.int64],
    tolerance: Array,
) -> tuple[Array, NDArray[np.int64], Array, Array]:
    """Reconstruct the local progressive surface of every rule (Algorithm 2, RLPS).

    Parameters
    ----------
    points, normals : (n, 3) float64
        Data and oriented normals: only points on the side of a unit belong to it.
    rules : Rules
        Rules, one a unit.
    n_neighbors, n_own : (r,) int64
        Points of each unit, before those on the other side are left out, and how many of them, the
        nearest, decide whether it is refined.
    tolerance : (r,) float64
        Precision epsilon, in the unit of the points.

    Returns
    -------
    rbf : (r, 13, 4) float64
        Centre (in the frame of the rule, divided by its radius) and weight of each basis function.
    terms : (r,) int64
        How many of them are in use; none where the quadric is precise enough.
    error : (r,) float64
        Largest residual that is left at the points that decide, in the unit of the points.
    worst : (r, 3) float64
        Point that has it; the centre where there is none.
    """
    rules = rules.bounded()
    centers, frames, coefficients, radius, *_ = rules
    n = len(centers)
    rbf, terms = np.zeros((n, CENTERS + 1, 4)), np.zeros(n, np.int64)
    error, worst = np.zeros(n), centers.copy()
    for row in range(n):
        data = unit_points(points, normals, rules, row, int(n_neighbors[row]), int(n_own[row]))
        unit = reconstruct_unit(data, coefficients[row], float(tolerance[row] / radius[row]))
        terms[row] = len(unit.terms)
        rbf[row, : len(unit.terms)] = unit.terms
        error[row] = unit.error * radius[row]
        worst[row] += radius[row] * unit.worst @ frames[row]
    return rbf, terms, error, worst


def unit_points(
    points: Array, normals: Array, rules: Rules, row: int, count: int, own: int
) -> UnitPoints:
    """Gather the points of a unit, and those of other faces that bound it.

    Faces combine as solids do (:func:`o3d_sofnn.reference.implicit.field.evaluate_field`). Where
    two meet in a convex edge, the points of one lie within the other, else that one would cut them
    off; where they meet in a concave edge, outside of it.

    Parameters
    ----------
    points, normals, rules
        As in :func:`reconstruct_units`.
    row : int
        Of the rule.
    count, own : int
        Of `n_neighbors` and `n_own`.

    Returns
    -------
    UnitPoints
    """
    center, frame, radius = rules.centers[row], rules.frames[row], rules.radius[row]
    side = frame[2] - rules.coefficients[row, 1:3] @ frame[:2]
    most = min(BOUND_COUNT * count, len(points))
    distance, index = query(points, center[None], most, BOUND_REACH * radius)
    found = index[0] < len(points)
    near, rank = index[0][found], np.flatnonzero(found)
    offset = (points[near] - center) / radius
    facing = normals[near]
    same = facing @ side >= SAME_SIDE * np.linalg.norm(side)
    behind = (offset * facing).sum(axis=1)
    apart = ~same & (np.abs(behind) >= APART * np.linalg.norm(offset, axis=1))
    own_face = same & (rank < count) & (distance[0][found] <= radius)
    bound = np.where(apart, np.where(behind > 0.0, 1, -1), 0)
    local = offset @ frame.T
    stretch = rules.stretch[row]
    reach = stretch * local[:, 0] ** 2 + local[:, 1] ** 2 / stretch
    inside = 1.0 / np.sqrt(np.maximum(reach, 1.0))  # as in the field
    local[:, :2] *= np.where(apart, inside, 1.0)[:, None]
    # Without points on the side of the unit there is nothing that others could bound.
    keep = (own_face | apart) & own_face.any()
    return UnitPoints(local[keep], bound[keep], ((rank < own) | apart)[keep])


def reconstruct_unit(data: UnitPoints, quadric: Array, tolerance: float) -> LocalSurface:
    """Append centres where the residual is largest, until it is small (Algorithm 2).

    The function ``h - quadric - sum of terms`` vanishes at the centres, and is left as it is at an
    offset point, half a radius above the middle.

    Parameters
    ----------
    data : UnitPoints
        Points of the unit.
    quadric : (6,) float64
        Coefficients.
    tolerance : float
        Precision epsilon, over the radius.

    Returns
    -------
    LocalSurface
    """
    local, bound, own = data
    start = local[:, 2] - quadric_height(quadric, local[:, 0], local[:, 1])
    places = np.array([[0.0, 0.0, quadric[0] + 0.5]])
    targets: Array = np.zeros(1)
    weights: Array = np.zeros(1)
    free = np.ones(len(local), bool)
    while True:
        rest = start - basis(local, places) @ weights
        wrong = np.where(bound == 0, np.abs(rest), np.maximum(bound * rest, 0.0))
        refined = len(places) > 1
        worst = _largest(wrong, free & own & (bound == 0))
        following = _largest(wrong, free & (own | refined))
        full = len(places) == CENTERS + 1
        if following is None or wrong[following] <= tolerance or full:
            break
        free[following] = False
        places = np.vstack([places, local[following]])
        targets = np.append(targets, start[following])
        system = basis(places, places) + RIDGE * np.eye(len(places))
        weights = np.asarray(np.linalg.solve(system, targets), np.float64)  # recompute f_i
    terms = np.column_stack([places, weights])
    return LocalSurface(
        terms=terms if refined else np.zeros((0, 4)),
        error=0.0 if worst is None else float(wrong[worst]),
        worst=np.zeros(3) if worst is None else local[worst],
    )


def quadric_height(quadric: Array, u: Array, v: Array) -> Array:
    """Evaluate ``c0 + c1 u + c2 v + p s`` with the parabola ``p = c3 u^2 + c4 uv + c5 v^2``."""
    c0, c1, c2, c3, c4, c5 = quadric.T
    parabola = c3 * u**2 + c4 * u * v + c5 * v**2
    return np.asarray(c0 + c1 * u + c2 * v + parabola * arc_over_parabola(parabola, u**2 + v**2))


def basis(x: Array, centers: Array) -> Array:
    """Evaluate Wendland's function C2 of the distances, ``(len(x), len(centers))``.

    Wendland, "Piecewise polynomial, positive definite and compactly supported radial functions of
    minimal degree" (1995).
    """
    t = np.linalg.norm(x[:, None] - centers, axis=2) / SUPPORT
    return np.asarray(np.maximum(1.0 - t, 0.0) ** 4 * (4.0 * t + 1.0))


def _largest(rest: Array, free: NDArray[np.bool_]) -> int | None:
    """Return the row with the largest residual that is no centre yet."""
    candidates = np.where(free, rest, 0.0)
    return int(candidates.argmax()) if (candidates > 0.0).any() else None
