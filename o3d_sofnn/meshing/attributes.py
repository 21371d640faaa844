"""What the mesh carries: weights that bring attributes of points to it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree

if TYPE_CHECKING:
    from o3d_sofnn.results import SurfaceEstimate


def attribute_weights(
    vertices: NDArray[np.float64],
    distinct: NDArray[np.float64],
    inverse: NDArray[np.int64],
    size: float,
    n_threads: int,
) -> scipy.sparse.csr_matrix:
    """Weights that carry attributes from points to vertices.

    Parameters
    ----------
    vertices : (m, 3) float64
        Where the attributes are wanted.
    distinct : (d, 3) float64
        Where they are known.
    inverse : (n,) int64
        Place of each point among those.
    size : float
        Distance over which a point counts.
    n_threads : int
        Number of threads.

    Returns
    -------
    scipy.sparse.csr_matrix, (m, n)
        Gaussian weights of the four nearest points; rows sum to one.
    """
    points = distinct[inverse]
    k = min(4, len(points))
    distance, index = KdTree(points, n_threads).query(vertices, k, np.inf, n_threads)
    weight = np.exp(-0.5 * (distance**2 - distance[:, :1] ** 2) / size**2)
    weight /= weight.sum(axis=1, keepdims=True)
    start = np.arange(0, len(vertices) * k + 1, k)
    return scipy.sparse.csr_matrix(
        (weight.ravel(), index.ravel(), start), shape=(len(vertices), len(points))
    )


def carry(
    details: SurfaceEstimate, attributes: Mapping[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """Bring values per point to the vertices, in their number type; colours become shares.

    Parameters
    ----------
    details : SurfaceEstimate
        Of n points, with m vertices.
    attributes : mapping of str to (n, ...) array
        Colours (as :func:`color_shares`) and floating-point values are blended; of others (labels)
        that of the point with the largest weight is taken.

    Returns
    -------
    dict of str to (m, ...) array
    """
    if not attributes:
        return {}
    weights = details.source_weights
    carried = {}
    for name, values in attributes.items():
        values = color_shares(values) if name == "colors" else values
        if values.dtype.kind == "f":
            flat = values.reshape(len(values), -1).astype(np.float64)
            blended = (weights @ flat).reshape(-1, *values.shape[1:])
            # Rounding may leave the range of the blended values, 1 for full intensity.
            blended = blended.clip(np.fmin.reduce(values), np.fmax.reduce(values))
            carried[name] = blended.astype(values.dtype)
        else:
            carried[name] = values[_heaviest(weights)]
    return carried


def color_shares(colors: NDArray[Any]) -> NDArray[np.floating[Any]]:
    """Return colours as shares of full intensity, 0 to 1; those in floating point are such.

    Parameters
    ----------
    colors : (n, k) array
        Integers are levels of 8 bits, or of 16 bits where the type or a value says so.
    """
    if colors.dtype.kind == "f":
        return colors
    full = 1.0 if colors.dtype.kind == "b" else 255.0
    if colors.dtype == np.uint16 or colors.max(initial=0) > full:
        full = 65535.0
    return (colors / full).astype(np.float32)


def _heaviest(weights: scipy.sparse.csr_matrix) -> NDArray[np.intp]:
    """Return for every row the column with the largest weight."""
    return np.asarray(weights.argmax(axis=1)).ravel()
