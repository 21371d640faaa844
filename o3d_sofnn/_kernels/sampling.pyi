"""Local fits, cells and typical data."""

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels.geometry import KdTree

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]

def fit_scales(
    tree: KdTree, points: _Floats, centers: _Floats, scales: _Ints
) -> tuple[_Floats, _Floats, _Floats, _Floats]:
    """Fit quadrics around `centers` (m, 3) to the nearest `scales` (s,) points, ascending.

    Returns unit normals (m, s, 3) of either sign, and, each (m, s), residual (root mean square),
    radius and surface variation.
    """

def fit_quadrics(
    tree: KdTree,
    points: _Floats,
    centers: _Floats,
    n_neighbors: _Ints,
    robust: _Floats,
    iterations: int,
    normals: _Floats | None,
    sides: _Floats | None,
    across: _Floats | None,
    stretch: _Floats,
) -> tuple[_Floats, _Floats, _Floats, _Floats, _Floats]:
    """Fit one quadric around each centre, to its own number of neighbours (r,).

    `robust` (r,) is the width of a residual weight that is iterated, 0 for none; with `normals`
    (n, 3) and `sides` (r, 3) points that face away from their rule do not count; with `across`
    (r, 3), tangents of the sides, neighbourhoods are ellipses that are narrow along these, and
    `stretch` (r,) times longer than wide.

    Returns frames (r, 3, 3) with rows tangent, tangent, normal, coefficients (r, 6) of
    ``h = c0 + c1 u + c2 v + c3 u^2 + c4 uv + c5 v^2`` with lengths divided by the radius, and, each
    (r,), residual, radius, and the share of the neighbourhood that faces the side.
    """

def typical_data(
    points: _Floats,
    offsets: _Ints,
    n_clusters: _Ints,
    iterations: int,
    tolerance: float,
    n_threads: int,
) -> _Floats:
    """Fuzzy c-means in every cell ``points[offsets[i]:offsets[i + 1]]``, eq. (1) to (6).

    Returns centres (sum of `n_clusters`, 3), cell by cell.
    """

def divide_cells(normals: _Floats, first: _Ints, n_threads: int) -> tuple[_Ints, _Ints]:
    """Divide the cells ``normals[first[i]:first[i + 1]]`` of unit normals by their side.

    Returns rows (n,), the part that faces the way of the first row at the head of each cell, and
    how many that part has (c,).
    """
