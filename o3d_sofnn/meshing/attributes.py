"""Attributes of the mesh: weights that transfer attributes from points to vertices."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.threads import thread_count

if TYPE_CHECKING:
    from o3d_sofnn.results import SurfaceEstimate


def attribute_weights(
    vertices: NDArray[np.float64],
    distinct: NDArray[np.float64],
    inverse: NDArray[np.int64],
    size: float,
) -> scipy.sparse.csr_matrix:
    """Return weights that transfer attributes from points to vertices.

    Parameters
    ----------
    vertices : (m, 3) float64
        Positions at which attributes are wanted.
    distinct : (d, 3) float64
        Distinct positions at which they are known.
    inverse : (n,) int64
        Index of each point among the distinct positions.
    size : float
        Width of the Gaussian weights.

    Returns
    -------
    scipy.sparse.csr_matrix, (m, n)
        Gaussian weights of the four nearest points; rows sum to one.
    """
    points = distinct[inverse]
    k = min(4, len(points))
    distance, index = KdTree(points, thread_count()).query(vertices, k, np.inf)
    weight = np.exp(-0.5 * (distance**2 - distance[:, :1] ** 2) / size**2)
    weight /= weight.sum(axis=1, keepdims=True)
    start = np.arange(0, len(vertices) * k + 1, k)
    return scipy.sparse.csr_matrix(
        (weight.ravel(), index.ravel(), start), shape=(len(vertices), len(points))
    )


def carry(
    details: SurfaceEstimate, attributes: Mapping[str, NDArray[Any]]
) -> dict[str, NDArray[Any]]:
    """Transfer attributes of the points to the vertices, in their number type.

    Parameters
    ----------
    details : SurfaceEstimate
        Surface of n points, with m vertices.
    attributes : mapping of str to (n, ...) array
        Colours (converted by :func:`color_shares`) and floating-point values are blended; other
        attributes (labels) are taken from the point with the largest weight.

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
            # Rounding errors may exceed the range of the blended values (1 for full intensity).
            blended = blended.clip(np.fmin.reduce(values), np.fmax.reduce(values))
            carried[name] = blended.astype(values.dtype)
        else:
            carried[name] = values[_heaviest(weights)]
    return carried


def color_shares(colors: NDArray[Any]) -> NDArray[np.floating[Any]]:
    """Return colours as fractions of full intensity, 0 to 1; floats are returned unchanged.

    Parameters
    ----------
    colors : (n, k) array
        Integers have 8 bits, or 16 bits if the number type or a value requires it.
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
