"""Triangles that meet others: twin of ``native/meshing/intersections.hpp``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Triangles = NDArray[np.int32]
Mask = NDArray[np.bool_]

TOUCH = 1e-4
"""Smallest gap divided by the size of the larger triangle, or sine of an angle of neighbours."""


def intersecting_pairs(vertices: Array, triangles: Triangles, suspect: Mask) -> NDArray[np.int32]:
    """Find triangles that cut, touch or cover others, but for what neighbours have in common.

    A pair is apart where a plane is found that divides it, with a gap on both sides; neighbours
    with a common corner where one through the corner divides their angles; those with a common edge
    where they are not folded flat.

    Returns
    -------
    (p, 2) int32
        Pairs of which at least one is suspect (t,), the lesser row first, in ascending order.
    """
    corners = vertices[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    pad = 2.0 * TOUCH * (high - low).max(axis=1)[:, None]
    low, high = low - pad, high + pad
    found = []
    for i in range(len(triangles) - 1):
        near = (low[i + 1 :] <= high[i]) & (low[i] <= high[i + 1 :])
        others = np.flatnonzero(near.all(axis=1) & (suspect[i] | suspect[i + 1 :])) + i + 1
        found.append(np.stack([np.full(len(others), i), others], axis=1))
    pairs = np.concatenate([np.zeros((0, 2), np.int64), *found])
    equal = triangles[pairs[:, 0]][:, :, None] == triangles[pairs[:, 1]][:, None, :]
    shared = equal.sum(axis=(1, 2))
    # Common corners come first, one after the other.
    order = [np.argsort(~equal.any(axis=2 - side), axis=1, kind="stable") for side in (0, 1)]
    first, second = (
        np.take_along_axis(corners[rows], places[:, :, None], axis=1)
        for rows, places in zip(pairs.T, order, strict=True)
    )
    meets = shared > 2
    for count, test in ((0, _strangers_meet), (1, _corners_meet), (2, _folded)):
        chosen = shared == count
        meets[chosen] = test(first[chosen], second[chosen])
    return np.asarray(pairs[meets], np.int32)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=-1))


def _strangers_meet(p: Array, q: Array) -> Mask:
    p, q = p - p[:, :1], q - p[:, :1]
    e, f = np.roll(p, -1, axis=1) - p, np.roll(q, -1, axis=1) - q
    size = np.maximum(_dot(e, e), _dot(f, f)).max(axis=1)
    n, m = np.cross(e[:, :1], e[:, 1:2]), np.cross(f[:, :1], f[:, 1:2])
    edges = np.cross(e[:, :, None], f[:, None]).reshape(-1, 9, 3)
    axes = np.concatenate([n, m, np.cross(n, e), np.cross(m, f), edges], axis=1)
    a, b = (np.einsum("nad,nkd->nak", axes, x) for x in (p, q))
    gap = np.maximum(a.min(axis=2) - b.max(axis=2), b.min(axis=2) - a.max(axis=2))
    apart = (gap > 0.0) & (gap**2 > TOUCH**2 * _dot(axes, axes) * size[:, None])
    return np.asarray(~apart.any(axis=1))


def _side(axis: Array, way: Array) -> NDArray[np.int64]:
    """1 or -1 for directions to the front or the back of a plane, 0 along it."""
    height = _dot(axis, way)
    away = height**2 > TOUCH**2 * _dot(axis, axis) * _dot(way, way)
    return np.asarray(np.where(away, np.sign(height), 0.0), np.int64)


def _parted(a: Array, b: Array) -> Mask:
    """Whether two directions differ."""
    turn = np.cross(a, b)
    far = _dot(turn, turn) > TOUCH**2 * _dot(a, a) * _dot(b, b)
    return np.asarray((_dot(a, b) < 0.0) | far)


def _corners_meet(p: Array, q: Array) -> Mask:
    u, w = p[:, 1:] - p[:, :1], q[:, 1:] - q[:, :1]
    # The plane across the way from the middle of one angle to that of the other divides most.
    a, b = u.sum(axis=1, keepdims=True), w.sum(axis=1, keepdims=True)
    axis = _dot(b, b)[..., None] * a - _dot(a, a)[..., None] * b
    least = np.minimum(_dot(axis, u).min(axis=1), -_dot(axis, w).max(axis=1))
    size = (_dot(u, u) + _dot(w, w)).sum(axis=1)
    apart = (least > 0.0) & (least**2 > TOUCH**2 * _dot(axis, axis)[:, 0] * size)
    for one, other in ((u, w), (w, u)):
        normal = np.cross(one[:, 0], one[:, 1])
        inward = np.stack([np.cross(normal, one[:, 0]), np.cross(one[:, 1], normal)], axis=1)
        # Beyond a plane through an edge, upright on its triangle.
        for k in range(2):
            sides = np.stack([_side(inward[:, k], other[:, j]) for j in range(2)], axis=1)
            free = np.stack([_parted(one[:, k], other[:, j]) for j in range(2)], axis=1)
            beyond = (sides <= 0).all(axis=1) & (sides.sum(axis=1) < 0)
            apart |= beyond & ((sides < 0) | free).all(axis=1)
        # On one side of the plane of the triangle, which one edge may touch outside of the angle.
        sides = np.stack([_side(normal, other[:, j]) for j in range(2)], axis=1)
        apart |= sides.prod(axis=1) > 0
        for j in range(2):
            outside = np.any([_side(inward[:, k], other[:, j]) < 0 for k in range(2)], axis=0)
            apart |= (sides[:, j] == 0) & (sides[:, 1 - j] != 0) & outside
    for i in range(2):
        for j in range(2):
            axis = np.cross(u[:, i], w[:, j])
            divided = _side(axis, u[:, 1 - i]) * _side(axis, w[:, 1 - j]) < 0
            apart |= _parted(u[:, i], w[:, j]) & divided
    return np.asarray(~apart)


def _folded(p: Array, q: Array) -> Mask:
    edge = p[:, 1] - p[:, 0]
    n, m = np.cross(edge, p[:, 2] - p[:, 0]), np.cross(edge, q[:, 2] - p[:, 0])
    turn = np.cross(n, m)
    flat = _dot(turn, turn) <= TOUCH**2 * _dot(n, n) * _dot(m, m)
    return np.asarray((_dot(n, m) > 0.0) & flat)
