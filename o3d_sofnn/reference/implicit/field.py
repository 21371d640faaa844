"""Signed distance from the nearest rules: twin of ``native/implicit/field.hpp``."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.reference.geometry.neighbors import query
from o3d_sofnn.reference.rules.inference import Contribution, contributions
from o3d_sofnn.reference.rules.rules import Rules

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SAME_FACE = (0.5, 0.8)
"""Range of the cosine between two normals above which their rules belong to one face."""
FACES = 3
"""Largest number of faces that meet."""
FAINT, FAINT_FLAT = -3.0, -5.0
"""Logarithm of the smallest membership of a curved and of a flat face, relative to the largest."""
FLAT = 0.1
"""Sum of the quadratic coefficients up to which a rule is flat."""
REACH = 4.0
"""Steepness of the membership in the tangent plane."""
BLUR = 0.2
"""Smallest width of the membership in the residual, divided by the radius."""


def evaluate_field(rules: Rules, rbf: Array, terms: NDArray[np.int64], x: Array, k: int) -> Array:
    """Blend the local implicits of the nearest rules by fuzzy basis functions, eq. (7) and (9).

    Rules are gathered into faces by their normals. Within a face, heights are blended; faces
    combine as solids do, by intersection where they meet in a convex edge and by union elsewhere
    (Ohtake et al. 2003, sharp features of MPU).

    Parameters
    ----------
    rules, x, k
        As in :func:`o3d_sofnn.reference.rules.inference.infer_normals`.
    rbf, terms
        Basis functions on top of the quadrics and how many, as
        :func:`o3d_sofnn.reference.implicit.rlps.reconstruct_units` returns them.

    Returns
    -------
    (m,) float64
        Signed distance, negative inside, in the unit of the points.
    """
    values = np.zeros(len(x))
    rules = rules.bounded()
    nearest = query(rules.centers, x, min(k, len(rules.centers)), np.inf)[1]
    for row, index in enumerate(nearest):
        local = rules.rows(index)
        rule = contributions(x[row], local, [rbf[number, : terms[number]] for number in index])
        near = -REACH * rule.reach + np.log(np.maximum(local.quality, 1e-300))
        z = rule.residual / np.maximum(local.tolerance, BLUR * local.radius)
        # The noisier a rule is, the more its neighbours may differ for no reason but noise.
        same = np.clip(0.9 - 5.0 * local.tolerance / local.radius, *SAME_FACE)
        flat = np.abs(local.coefficients[:, 3:]).sum(axis=1) < FLAT
        faint = np.where(flat, FAINT_FLAT, FAINT)
        values[row] = _combine(rule, near, near - 0.5 * z**2, same, faint)
    return values


def _combine(
    rule: Contribution, near: Array, membership: Array, same: Array, faint: Array
) -> float:
    free = np.ones(len(near), bool)
    faces: list[Mask] = []
    heights: list[float] = []
    while len(faces) < FACES:
        eligible = free & ((near > near.max() + faint) | (not faces))
        if not eligible.any():
            break
        best = int(np.where(eligible, membership, -np.inf).argmax())
        face = free & (rule.normal @ rule.normal[best] >= same[best])
        face[best] = True  # the frame of a given rule need not be orthonormal
        weight = np.exp(membership[face] - membership[face].max())
        heights.append(float(weight @ rule.residual[face] / weight.sum()))  # Eq. (7) and (9)
        faces.append(face)
        free &= ~face
    kinds = {
        (i, j): _meet_convex(rule, near, faces[i], faces[j])
        for i, j in itertools.combinations(range(len(faces)), 2)
    }
    if len(faces) < FACES:
        return _solid(heights[0], heights[1], kinds[0, 1]) if kinds else heights[0]
    # The two faces that meet in an edge of another kind than the other edges come first.
    usual = sum(kinds.values()) >= 2
    first, second = next((pair for pair, kind in kinds.items() if kind != usual), (0, 1))
    both = _solid(heights[first], heights[second], kinds[first, second])
    return _solid(both, heights[FACES - first - second], usual)


def _solid(first: float, second: float, convex: bool) -> float:
    return max(first, second) if convex else min(first, second)


def _meet_convex(rule: Contribution, near: Array, first: Mask, second: Mask) -> bool:
    """Two faces meet in a convex edge when each lies behind the other; all pairs of rules vote."""
    apart = rule.foot[second] - rule.foot[first][:, None]
    ahead = (apart * rule.normal[first][:, None]).sum(axis=2)  # of a rule of the first face
    behind = (apart * rule.normal[second]).sum(axis=2)
    weight = np.exp(near - near.max())
    return bool(weight[first] @ (ahead - behind) @ weight[second] < 0.0)
