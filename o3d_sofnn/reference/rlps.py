"""Radial basis functions on top of the quadric of a rule: twin of ``native/rlps.hpp``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .local_fit import arc_over_parabola
from .neighbors import query
from .rules import Rules

Array = NDArray[np.float64]

CENTERS = 12
"""Most centres of a unit, delta of Algorithm 2."""
OFFSETS = 2
"""Offset points of a unit."""
SAME_SIDE = 0.5
"""Least cosine between the normal of a unit and those of its points."""
SUPPORT = 1.0
"""Support of the basis functions, over the radius of the unit."""
RIDGE = 1e-6
"""Added to the diagonal of the system, against centres on top of each other."""


class LocalSurface(NamedTuple):
    """What :func:`reconstruct_unit` learned, in the frame of the rule and over its radius."""

    terms: Array
    error: float
    worst: Array


def reconstruct_units(
    points: Array,
    normals: Array,
    rules: Rules,
    n_neighbors: NDArray[np.int64],
    tolerance: Array,
) -> tuple[Array, NDArray[np.int64], Array, Array]:
    """Reconstruct the local progressive surface of every rule (Algorithm 2, RLPS).

    Parameters
    ----------
    points, normals : (n, 3) float64
        Data and oriented normals: only points on the side of a unit belong to it.
    rules : Rules
        Rules, one a unit.
    n_neighbors : (r,) int64
        Points of each unit, before those on the other side are left out.
    tolerance : (r,) float64
        Precision epsilon, in the unit of the points.

    Returns
    -------
    rbf : (r, 14, 4) float64
        Centre, in the frame of the rule and over its radius, and weight of each basis function.
    terms : (r,) int64
        How many of them are in use; none where the quadric is precise enough.
    error : (r,) float64
        Largest residual that is left, in the unit of the points.
    worst : (r, 3) float64
        Point that has it; the centre where there is none.
    """
    centers, frames, coefficients, radius, _, _ = rules
    n = len(centers)
    rbf, terms = np.zeros((n, CENTERS + OFFSETS, 4)), np.zeros(n, np.int64)
    error, worst = np.zeros(n), centers.copy()
    for row in range(n):
        _, slope_u, slope_v = coefficients[row, :3]
        tangent, bitangent, axis = frames[row]
        side = axis - slope_u * tangent - slope_v * bitangent
        _, index = query(points, centers[row : row + 1], int(n_neighbors[row]), radius[row])
        near = index[index < len(points)]
        near = near[normals[near] @ side >= SAME_SIDE * np.linalg.norm(side)]
        local = (points[near] - centers[row]) / radius[row] @ frames[row].T
        unit = reconstruct_unit(local, coefficients[row], float(tolerance[row] / radius[row]))
        terms[row] = len(unit.terms)
        rbf[row, : len(unit.terms)] = unit.terms
        error[row] = unit.error * radius[row]
        worst[row] += radius[row] * unit.worst @ frames[row]
    return rbf, terms, error, worst


def reconstruct_unit(local: Array, quadric: Array, tolerance: float) -> LocalSurface:
    """Append centres where the residual is largest, until it is small (Algorithm 2).

    The function ``h - quadric - sum of terms`` vanishes at the centres, and is left as it is at two
    offset points, half a radius above and below the middle.

    Parameters
    ----------
    local : (m, 3) float64
        Points in the frame of the rule, over its radius.
    quadric : (6,) float64
        Coefficients.
    tolerance : float
        Precision epsilon, over the radius.

    Returns
    -------
    LocalSurface
    """
    start = local[:, 2] - quadric_height(quadric, local[:, 0], local[:, 1])
    places = np.array([[0.0, 0.0, quadric[0] + 0.5], [0.0, 0.0, quadric[0] - 0.5]])
    targets: Array = np.zeros(OFFSETS)
    weights: Array = np.zeros(OFFSETS)
    rest: Array = np.abs(start)
    free = np.ones(len(local), bool)
    worst = _largest(rest, free)
    while worst is not None and rest[worst] > tolerance and len(places) < OFFSETS + CENTERS:
        free[worst] = False
        places = np.vstack([places, local[worst]])
        targets = np.append(targets, start[worst])
        system = basis(places, places) + RIDGE * np.eye(len(places))
        weights = np.asarray(np.linalg.solve(system, targets), np.float64)  # recompute f_i
        rest = np.abs(start - basis(local, places) @ weights)
        worst = _largest(rest, free)
    terms = np.column_stack([places, weights])
    return LocalSurface(
        terms=terms if len(terms) > OFFSETS else np.zeros((0, 4)),
        error=0.0 if worst is None else float(rest[worst]),
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
