"""Plane and quadric fits around given centres: twin of ``native/sampling/local_fit.hpp``."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.reference.geometry.neighbors import query

Array = NDArray[np.float64]

STEEPEST = 0.75
"""Squared slope, divided by the diagonal's, at which an arc ends."""
NOISY_NORMALS = 5.0
"""How flat the weight by angle is for small angles, in units of residual width by radius."""
RADIUS = 1.1
"""Radius of a fit, divided by the distance of its last neighbour."""
PARALLEL = 1e-6
"""Part of a vector across another one, divided by its length, below which it is rounding."""
RIDGE = np.array([1e-12, 1e-9, 1e-9, 1.00001e-4, 1.00001e-4, 1.00001e-4])
"""Penalty on the coefficients, divided by the sum of the weights: the plane is not penalised."""


class Fit(NamedTuple):
    """One quadric ``h = c0 + c1 u + c2 v + c3 u^2 + c4 uv + c5 v^2`` in units of its radius."""

    normal: Array
    frame: Array
    coefficients: Array
    residual: float
    radius: float
    variation: float
    support: float


def fit_scales(
    points: Array, centers: Array, scales: NDArray[np.int64]
) -> tuple[Array, Array, Array, Array]:
    """Fit a quadric around every centre, once for each neighbourhood size (Algorithm 1, step 3).

    Parameters
    ----------
    points : (n, 3) float64
        Data.
    centers : (m, 3) float64
        Where to fit.
    scales : (s,) int64
        Numbers of neighbours, ascending; more than `n` means all points.

    Returns
    -------
    normals : (m, s, 3) float64
        Unit normals of the quadrics above the centres, of either sign.
    residual, radius, variation : (m, s) float64
        Root-mean-square residual and radius of the fit (unit of the points), surface variation
        (0 to 1/3).
    """
    fits = [[fit_quadric(points, center, Wanted(size)) for size in scales] for center in centers]
    return (
        np.array([[fit.normal for fit in row] for row in fits]),
        np.array([[fit.residual for fit in row] for row in fits]),
        np.array([[fit.radius for fit in row] for row in fits]),
        np.array([[fit.variation for fit in row] for row in fits]),
    )


class Wanted(NamedTuple):
    """Which points a fit shall see: the arrays of a list of fits, or the values of one of them."""

    n_neighbors: Any
    robust: Any = 0.0
    sides: Any = None
    across: Any = None
    stretch: Any = 1.0

    def row(self, i: int) -> Wanted:
        """Return the values of one fit."""
        return Wanted(*(None if values is None else values[i] for values in self))


def fit_quadrics(
    points: Array, centers: Array, wanted: Wanted, iterations: int, normals: Array | None
) -> tuple[Array, Array, Array, Array, Array]:
    """Fit one quadric around each centre (Algorithm 1, steps 3 and 5).

    Parameters
    ----------
    points : (n, 3) float64
        Data.
    centers : (m, 3) float64
        Centres of the fits.
    wanted : Wanted
        Points in each fit, (m,); width of a Gaussian weight in the residual, (m,), in the unit of
        the points, 0 for none; oriented normals of the fits, (m, 3), or None; unit tangents along
        which the neighbourhoods are narrow, (m, 3), or None; how many times longer than wide they
        are, (m,), at the same area.
    iterations : int
        Repetitions with the weight in the residual.
    normals : (n, 3) float64, or None
        Oriented normals of the points, which enter by the square of the cosine to the normal of the
        fit (where there is noise, small angles do not count), and hardly at all where they face the
        other way.

    Returns
    -------
    frames : (m, 3, 3) float64
        Rows: two tangents and the normal of the plane.
    coefficients : (m, 6) float64
        Of the quadrics, dimensionless.
    residual, radius, support : (m,) float64
        As in :func:`fit_scales`, and the share of the neighbourhood that faces the side.
    """
    fits = [
        fit_quadric(points, center, wanted.row(row), iterations, normals)
        for row, center in enumerate(centers)
    ]
    return (
        np.array([fit.frame for fit in fits]),
        np.array([fit.coefficients for fit in fits]),
        np.array([fit.residual for fit in fits]),
        np.array([fit.radius for fit in fits]),
        np.array([fit.support for fit in fits]),
    )


def fit_quadric(
    points: Array,
    center: Array,
    wanted: Wanted,
    iterations: int = 0,
    normals: Array | None = None,
) -> Fit:
    """Fit one plane and, in its frame, one quadric by weighted least squares.

    Parameters
    ----------
    points : (n, 3) float64
        Data.
    center : (3,) float64
        Origin of the frame.
    wanted : Wanted
        Which points it sees, as in :func:`fit_quadrics`.
    iterations : int, default 0
        Repetitions with the weight in the residual.
    normals : (n, 3) float64, optional
        Oriented normals of the points.

    Returns
    -------
    Fit
    """
    n_neighbors, robust, side, across, stretch = wanted
    count = int(np.floor(n_neighbors * stretch + 0.5))
    distance, index = query(points, center[None], min(count, len(points)), np.inf)
    radius = RADIUS * distance[0, -1] / np.sqrt(stretch)
    local = (points[index[0]] - center) * (1.0 / radius if radius > 0.0 else 0.0)
    near = 1.0 - (local**2).sum(axis=1)
    if across is not None and side is not None:
        along = across_both(across, side)
        near -= (stretch - 1.0) * (local @ across) ** 2 + (1.0 / stretch - 1.0) * (
            local @ along
        ) ** 2
    near = np.maximum(near, 0.0)
    weight = near
    if normals is not None and side is not None:
        gain = 1.0 + NOISY_NORMALS * robust / max(distance[0, -1], 1e-300)
        agree = np.minimum(gain * np.maximum(normals[index[0]] @ side, 0.0), 1.0)
        weight = weight * (agree**2 + 1e-6)

    total = max(weight.sum(), 1e-300)
    support = weight.sum() / max(near.sum(), 1e-300)
    mean = weight @ local / total
    covariance = (weight[:, None] * local).T @ local / total - np.outer(mean, mean)
    value, vector = np.linalg.eigh(covariance)
    frame = frame_of(vector[:, 0])
    if across is not None and stretch > 1.0:
        frame = frame_along(vector[:, 0], across)
    u, v, h = frame @ local.T

    basis = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], axis=1)
    coefficients, rms, scale = np.zeros(6), 0.0, np.inf
    target = h
    for _ in range((iterations + 1 if robust > 0.0 else 1) if weight.any() else 0):
        w = weight * np.exp(-0.5 * ((target - basis @ coefficients) / scale) ** 2)
        sum_w, sum_w2 = max(w.sum(), 1e-300), max((w**2).sum(), 1e-300)
        normal_matrix = (w[:, None] * basis).T @ basis + np.diag(sum_w * RIDGE)
        parabola = basis[:, 3:] @ coefficients[3:]
        target = h - parabola * (arc_over_parabola(parabola, u**2 + v**2) - 1.0)
        coefficients = np.linalg.solve(normal_matrix, basis.T @ (w * target))

        residual = target - basis @ coefficients
        effective = sum_w**2 / sum_w2
        freedom = effective / max(effective - 6.0, 1.0)
        rms = float(np.sqrt(w @ residual**2 / sum_w * freedom))
        scale = max(robust / radius if radius > 0.0 else 0.0, 0.5 * rms)

    t1, t2, n = frame
    normal = n - coefficients[1] * t1 - coefficients[2] * t2
    variation = value[0] / max(value.sum(), 1e-300)
    return Fit(
        normal=normal / np.linalg.norm(normal),
        frame=frame,
        coefficients=coefficients,
        residual=rms * radius,
        radius=radius,
        variation=variation,
        support=support,
    )


def arc_over_parabola(parabola: Array, sq_distance: Array) -> Array:
    """Return the height of a circle, divided by that of the parabola with the same curvature.

    Parameters
    ----------
    parabola : (n,) float64
        Height of the parabola.
    sq_distance : (n,) float64
        Squared distance from the vertex.

    Returns
    -------
    (n,) float64
        1 at the vertex; the arc ends before it turns vertical.
    """
    steep = np.minimum(4.0 * parabola**2 / np.maximum(sq_distance, 1e-30), STEEPEST)
    return np.asarray(2.0 / (1.0 + np.sqrt(1.0 - steep)))


def frame_along(normal: Array, direction: Array) -> Array:
    """Frame of a unit normal whose first tangent is nearest to a direction, (3, 3).

    Any frame of the normal where that is the direction.
    """
    tangent = direction - (direction @ normal) * normal
    if np.linalg.norm(tangent) <= PARALLEL * np.linalg.norm(direction):
        return frame_of(normal)
    tangent /= np.linalg.norm(tangent)
    return np.array([tangent, np.cross(normal, tangent), normal])


def across_both(normal: Array, other: Array) -> Array:
    """Find the unit vector across a unit vector and another one, any where that is parallel."""
    both = np.cross(other, normal)
    length = float(np.linalg.norm(both))
    if length <= PARALLEL * np.linalg.norm(other):
        return np.asarray(frame_of(normal)[0])
    return np.asarray(both / length)


def frame_of(normal: Array) -> Array:
    """Complete a unit normal to a right-handed frame.

    Duff et al., "Building an orthonormal basis, revisited" (2017).

    Parameters
    ----------
    normal : (3,) float64
        Unit.

    Returns
    -------
    (3, 3) float64
        Rows: two tangents, `normal`.
    """
    x, y, z = normal
    s = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (s + z)
    b = x * y * a
    return np.array([[1.0 + s * x * x * a, s * b, -s * x], [b, s + y * y * a, -y], [x, y, z]])
