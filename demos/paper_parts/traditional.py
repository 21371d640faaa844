"""The method that the paper compares with: one variational implicit surface through everything.

Normals come from planes through the k nearest neighbours, oriented along a spanning tree
(Hoppe et al. 1992, in Open3D). Each point and an offset point on either side of it are centres of
one interpolant, ``f(x) = sum_j w_j |x - c_j|^3 + linear`` (triharmonic in space; Turk and O'Brien
1999, Carr et al. 2001), with the values 0, +d and -d. Memory grows with the square of the number of
points, time with its cube.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

Array = NDArray[Any]

OFFSET = 0.01
"""Largest distance of the offset points from the surface, as a fraction of the diagonal."""
BLOCK = 2048
"""Number of rows of kernel values in memory at a time during the evaluation."""


@dataclass(frozen=True)
class Interpolant:
    """A triharmonic radial basis function with a linear polynomial.

    Attributes
    ----------
    centers : (n, 3) float64
        Centres relative to ``origin``, divided by ``scale``.
    weights : (n,) float64
        Weights of the centres.
    linear : (4,) float64
        Constant and slopes of the polynomial.
    origin : (3,) float64
        Origin in the coordinates of the points.
    scale : float
        Unit of length of the interpolant, in the unit of the points.
    """

    centers: Array
    weights: Array
    linear: Array
    origin: Array
    scale: float

    def __call__(self, x: Array) -> Array:
        """Return the values, (m,), at (m, 3) queries, in the unit of the points."""
        local = (x - self.origin) / self.scale
        values = self.linear[0] + local @ self.linear[1:]
        for start in range(0, len(local), BLOCK):
            rows = slice(start, start + BLOCK)
            values[rows] += _kernel(local[rows], self.centers) @ self.weights
        return self.scale * values


@dataclass(frozen=True)
class Fit:
    """The result of the traditional method.

    Attributes
    ----------
    interpolant : Interpolant
        The interpolant, negative inside.
    normals : (n, 3) float64
        Normals of the points.
    n_centers : int
        Number of points and offset points.
    seconds : dict of str to float
        Time of normals and solution.
    """

    interpolant: Interpolant
    normals: Array
    n_centers: int
    seconds: dict[str, float] = field(default_factory=dict)


def fit(points: Array, n_neighbors: int = 30) -> Fit:
    """Fit one implicit surface to all points.

    Parameters
    ----------
    points : (n, 3) float64
        Points in any unit; duplicates count once.
    n_neighbors : int, default 30
        Number of neighbours of the planes, and in the graph along which they are oriented.

    Returns
    -------
    Fit

    Raises
    ------
    MemoryError
        The matrix of the 3 n centres does not fit into memory.
    """
    points = np.unique(points, axis=0)
    started = time.perf_counter()
    normals = plane_normals(points, n_neighbors)
    seconds = {"normals": time.perf_counter() - started}
    started = time.perf_counter()
    centers, values = _constraints(points, normals)
    interpolant = interpolate(centers, values)
    seconds["solution"] = time.perf_counter() - started
    return Fit(interpolant, normals, len(centers), seconds)


def plane_normals(points: Array, n_neighbors: int) -> Array:
    """Return the normals of the k-nearest-neighbour planes, oriented along a spanning tree."""
    import open3d as o3d

    pcd = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    pcd.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(n_neighbors))
    pcd.orient_normals_consistent_tangent_plane(n_neighbors)
    return np.asarray(pcd.normals).copy()


def interpolate(centers: Array, values: Array) -> Interpolant:
    """Solve for the triharmonic interpolant through (n, 3) distinct centres.

    The kernel is positive definite on weights that are orthogonal to the linear polynomials. Four
    Householder reflections restrict it to these, so that a Cholesky factorisation suffices: half
    the operations of the usual LU.
    """
    origin = centers.mean(axis=0)
    scale = float(np.linalg.norm(np.ptp(centers, axis=0)))
    x = (centers - origin) / scale
    right = values / scale
    n = len(x)
    matrix = _kernel(x, x)
    (packed, tau), upper = scipy.linalg.qr(
        np.column_stack([np.ones(n), x]), mode="raw", check_finite=False
    )
    vectors = np.tril(packed, -1) + np.eye(n, 4)
    for k in range(4):
        v = vectors[:, k]
        # H A H with H = I - tau v v' is a symmetric update of rank two.
        half = tau[k] * (matrix @ v)
        half -= 0.5 * tau[k] * (v @ half) * v
        _subtract_outer(matrix, v, half)
        right = right - tau[k] * (v @ right) * v
    inner = np.asfortranarray(matrix[4:, 4:])
    coupling = matrix[:4, 4:].copy()
    del matrix
    factor = scipy.linalg.cholesky(inner, lower=True, overwrite_a=True, check_finite=False)
    inside = scipy.linalg.cho_solve((factor, True), right[4:], check_finite=False)
    linear = scipy.linalg.solve_triangular(upper[:4], right[:4] - coupling @ inside)
    weights = np.concatenate([np.zeros(4), inside])
    for k in reversed(range(4)):
        weights = weights - tau[k] * (vectors[:, k] @ weights) * vectors[:, k]
    return Interpolant(x, weights, linear, origin, scale)


def _constraints(points: Array, normals: Array) -> tuple[Array, Array]:
    """Return the centres and their values: points, and an offset point on either side of each."""
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    tree = cKDTree(points)
    length = np.full(len(points), OFFSET * diagonal)
    for side in (1.0, -1.0):
        # An offset point must be nearer to its own point than to any other (Carr et al. 2001).
        for _ in range(6):
            own = tree.query(points + side * length[:, None] * normals)[1] == np.arange(len(points))
            length = np.where(own, length, 0.5 * length)
    shift = length[:, None] * normals
    centers = np.concatenate([points, points + shift, points - shift])
    return centers, np.concatenate([np.zeros(len(points)), length, -length])


def _kernel(a: Array, b: Array) -> Array:
    distance = cdist(a, b)
    return distance * distance * distance


def _subtract_outer(matrix: Array, v: Array, half: Array) -> None:
    """Subtract ``v half' + half v'`` in blocks, without a second matrix."""
    for start in range(0, len(matrix), BLOCK):
        rows = slice(start, start + BLOCK)
        matrix[rows] -= np.outer(v[rows], half)
        matrix[rows] -= np.outer(half[rows], v)
