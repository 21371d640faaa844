"""What the mesh carries: vertex normals, and weights that bring attributes of points to it."""

from __future__ import annotations

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from ._kernels import KdTree
from .metrics import area_vectors


def mesh_normals(
    vertices: NDArray[np.float64], triangles: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Average the normals of the triangles by their area; unit vertex normals, (m, 3)."""
    facing = area_vectors(vertices, triangles)
    total = np.stack(
        [np.bincount(triangles.ravel(), np.repeat(f, 3), len(vertices)) for f in facing.T], axis=1
    )
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 0, total / np.maximum(length, 1e-300), [0.0, 0.0, 1.0])


def attribute_weights(
    vertices: NDArray[np.float64], points: NDArray[np.float64], size: float, n_threads: int
) -> scipy.sparse.csr_matrix:
    """Weights that carry attributes from points to vertices.

    Parameters
    ----------
    vertices : (m, 3) float64
        Where the attributes are wanted.
    points : (n, 3) float64
        Where they are known.
    size : float
        Distance over which a point counts.
    n_threads : int
        Threads.

    Returns
    -------
    scipy.sparse.csr_matrix, (m, n)
        Gaussian weights of the four nearest points; rows sum to one.
    """
    k = min(4, len(points))
    distance, index = KdTree(points, n_threads).query(vertices, k, np.inf, n_threads)
    weight = np.exp(-0.5 * (distance**2 - distance[:, :1] ** 2) / size**2)
    weight /= weight.sum(axis=1, keepdims=True)
    start = np.arange(0, len(vertices) * k + 1, k)
    return scipy.sparse.csr_matrix(
        (weight.ravel(), index.ravel(), start), shape=(len(vertices), len(points))
    )
