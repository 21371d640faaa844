"""Plane and quadric fits around given centres: twin of ``native/local_fit.hpp``."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.reference.neighbors import query

Array = NDArray[np.float64]

STEEPEST = 0.75
"""Squared slope, over that of the diagonal, at which an arc ends."""
NOISY_NORMALS = 5.0
"""How flat the weight by angle is for small angles, over the ratio of residual width to radius."""
RADIUS = 1.1
"""Radius of a fit over the distance of its last neighbour."""
RIDGE = np.array([1e-12, 1e-9, 1e-9, 1.00001e-4, 1.00001e-4, 1.00001e-4])
"""Penalty on the coefficients, over the sum of the weights: the plane stays free."""


class Fit(NamedTuple):
    """One quadric ``h = c0 + c1 u + c2 v + c3 u^2 + c4 uv + c5 v^2``, lengths over its radius."""

    normal: Array
    foot: Array
    frame: Array
    coefficients: Array
    info: Array


def fit_scales(points: Array, centers: Array, scales: NDArray[np.int64]) -> tuple[Array, Array]:
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
    info : (m, s, 4) float64
        Root-mean-square residual (unit of the points), standard error of the normal (radians),
        radius of the fit (unit of the points), surface variation (0 to 1/3).
    """
    normals = np.zeros((len(centers), len(scales), 3))
    info = np.zeros((len(centers), len(scales), 4))
    for row, center in enumerate(centers):
        for column, size in enumerate(scales):
            fit = fit_quadric(points, center, int(size))
            normals[row, column], info[row, column] = fit.normal, fit.info[:4]
    return normals, info


def fit_rules(
    points: Array,
    centers: Array,
    n_neighbors: NDArray[np.int64],
    robust: Array,
    iterations: int,
    normals: Array | None,
    sides: Array | None,
    across: Array | None,
    stretch: Array,
) -> tuple[Array, Array, Array, Array]:
    """Fit the consequent quadric of every rule (Algorithm 1, steps 3 and 5).

    Parameters
    ----------
    points : (n, 3) float64
        Data.
    centers : (m, 3) float64
        Centres of the rules.
    n_neighbors : (m,) int64
        Points in each fit.
    robust : (m,) float64
        Width of a Gaussian weight in the residual, in the unit of the points; 0 for none.
    iterations : int
        Repetitions with that weight.
    normals, sides : (n, 3) and (m, 3) float64, or None
        Oriented normals of points and rules: points enter by the square of the cosine between the
        two (where there is noise, small angles do not count), and hardly at all where they face
        the other way.
    across : (m, 3) float64 or None
        Unit tangents along which the neighbourhoods are narrow.
    stretch : (m,) float64
        How many times longer than wide they are; they cover the same area.

    Returns
    -------
    feet : (m, 3) float64
        Centres moved onto their quadrics.
    frames : (m, 3, 3) float64
        Rows: two tangents and the normal of the plane.
    coefficients : (m, 6) float64
        Of the quadrics, dimensionless.
    info : (m, 5) float64
        As in :func:`fit_scales`, and the share of the neighbourhood that faces the side.
    """
    fits = [
        fit_quadric(
            points,
            center,
            int(n_neighbors[row]),
            robust=float(robust[row]),
            iterations=iterations,
            normals=normals,
            side=None if sides is None else sides[row],
            across=None if across is None else across[row],
            stretch=float(stretch[row]),
        )
        for row, center in enumerate(centers)
    ]
    return (
        np.array([fit.foot for fit in fits]),
        np.array([fit.frame for fit in fits]),
        np.array([fit.coefficients for fit in fits]),
        np.array([fit.info for fit in fits]),
    )


def fit_quadric(
    points: Array,
    center: Array,
    n_neighbors: int,
    *,
    robust: float = 0.0,
    iterations: int = 0,
    normals: Array | None = None,
    side: Array | None = None,
    across: Array | None = None,
    stretch: float = 1.0,
) -> Fit:
    """Fit one plane and, in its frame, one quadric by weighted least squares.

    Parameters
    ----------
    points : (n, 3) float64
        Data.
    center : (3,) float64
        Origin of the frame.
    n_neighbors : int
        Points in the fit.
    robust : float, default 0.0
        Width of the weight in the residual, in the unit of the points; 0 for none.
    iterations : int, default 0
        Repetitions with that weight.
    normals : (n, 3) float64, optional
        Oriented normals of the points.
    side : (3,) float64, optional
        Oriented normal at the centre.
    across : (3,) float64, optional
        Unit tangent along which the neighbourhood is narrow.
    stretch : float, default 1.0
        How many times longer than wide it is.

    Returns
    -------
    Fit
    """
    count = int(np.floor(n_neighbors * stretch + 0.5))
    distance, index = query(points, center[None], min(count, len(points)), np.inf)
    radius = RADIUS * distance[0, -1] / np.sqrt(stretch)
    local = (points[index[0]] - center) * (1.0 / radius if radius > 0.0 else 0.0)
    near = 1.0 - (local**2).sum(axis=1)
    if across is not None and side is not None:
        along = np.cross(side, across) / np.linalg.norm(np.cross(side, across))
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
    coefficients, rms, slope_error, scale = np.zeros(6), 0.0, 0.0, np.inf
    target = h
    for _ in range(iterations + 1 if robust > 0.0 else 1):
        w = weight * np.exp(-0.5 * ((target - basis @ coefficients) / scale) ** 2)
        sum_w, sum_w2 = max(w.sum(), 1e-300), max((w**2).sum(), 1e-300)
        normal_matrix = (w[:, None] * basis).T @ basis + np.diag(sum_w * RIDGE)
        parabola = basis[:, 3:] @ coefficients[3:]
        target = h - parabola * (arc_over_parabola(parabola, u**2 + v**2) - 1.0)
        coefficients = np.linalg.solve(normal_matrix, basis.T @ (w * target))
        inverse = np.linalg.inv(normal_matrix)

        residual = target - basis @ coefficients
        effective = sum_w**2 / sum_w2
        freedom = effective / max(effective - 6.0, 1.0)
        rms = float(np.sqrt(w @ residual**2 / sum_w * freedom))
        slope_error = rms * float(np.sqrt((inverse[1, 1] + inverse[2, 2]) * sum_w2 / sum_w))
        scale = max(robust / radius if radius > 0.0 else 0.0, 0.5 * rms)

    t1, t2, n = frame
    normal = n - coefficients[1] * t1 - coefficients[2] * t2
    variation = value[0] / max(value.sum(), 1e-300)
    return Fit(
        normal=normal / np.linalg.norm(normal),
        foot=center + radius * coefficients[0] * n,
        frame=frame,
        coefficients=coefficients,
        info=np.array([rms * radius, slope_error, radius, variation, support]),
    )


def arc_over_parabola(parabola: Array, sq_distance: Array) -> Array:
    """Height of a circle over that of the parabola with the same curvature at its vertex.

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
    """Frame of a unit normal whose first tangent is nearest to a direction, (3, 3)."""
    tangent = direction - (direction @ normal) * normal
    tangent /= np.linalg.norm(tangent)
    return np.array([tangent, np.cross(normal, tangent), normal])


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
