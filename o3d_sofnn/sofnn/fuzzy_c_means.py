"""Typical data by fuzzy c-means: section 3.1 of the paper, equations (1) to (6)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Temporaries of one chunk hold about this many float64 (8 MB); it bounds memory, not the result.
CHUNK_ELEMENTS = 2**20


@dataclass(frozen=True)
class FuzzyPartition:
    """Result of :func:`fuzzy_c_means`.

    Attributes
    ----------
    centers : (c, d) float64
        Cluster centres, the typical data, in the units of the input.
    memberships : (n, c) float64
        Degree to which each row belongs to each centre; every row sums to one.
    objective : (n_iter,) float64
        Value of equation (1) after each iteration; it never increases. Infinite where the square
        of the unit of the data exceeds the range of float64.
    n_iter : int
        Iterations done.
    converged : bool
        Whether the memberships moved by less than `tol` in the last iteration.
    """

    centers: NDArray[np.float64]
    memberships: NDArray[np.float64]
    objective: NDArray[np.float64]
    n_iter: int
    converged: bool


def fuzzy_c_means(
    x: ArrayLike,
    n_clusters: int,
    *,
    m: float = 2.0,
    metric: ArrayLike | None = None,
    tol: float = 1e-5,
    max_iter: int = 300,
    random_state: int | np.random.Generator | None = 0,
    memberships: ArrayLike | None = None,
) -> FuzzyPartition:
    """Partition data into overlapping clusters whose centres are the typical data.

    Parameters
    ----------
    x : (n, d) array
        Data, finite. To cluster input-output pairs, stack them as columns.
    n_clusters : int
        Number of centres `c`, 2 <= c < n.
    m : float, default 2.0
        Smoothing weight (`s` in the paper), greater than 1; larger is fuzzier.
    metric : (d, d) array, optional
        Symmetric positive definite matrix `A` of the distance; None is the identity.
    tol : float, default 1e-5
        Stop when no membership moves by this much.
    max_iter : int, default 300
        Largest number of iterations.
    random_state : int, Generator or None, default 0
        Source of the random first memberships; None is not reproducible.
    memberships : (n, c) array, optional
        First memberships in place of random ones; rows sum to one.

    Returns
    -------
    FuzzyPartition
        Centres, memberships, objective per iteration, and how the iteration ended.

    Raises
    ------
    ValueError
        If an argument has a wrong shape or range, or `x` is not finite.

    Notes
    -----
    A row at distance zero from several centres is shared equally among them (the paper asks
    only that these memberships sum to one). A centre that no row belongs to, as happens with
    fewer distinct rows than centres, makes equation (2) 0/0 and stays where it is.
    Temporary memory is bounded; the memberships themselves are n * c numbers.
    """
    data = _check_data(x)
    n_rows, n_columns = data.shape
    _check_options(n_rows, n_clusters, m, tol, max_iter)
    factor = _metric_factor(metric, n_columns)
    if memberships is None:
        u = np.random.default_rng(random_state).random((n_rows, n_clusters))
        u /= u.sum(axis=1, keepdims=True)
    else:
        u = _check_memberships(memberships, n_rows, n_clusters, m)

    # Scaling by a power of two is exact and keeps squares from overflowing or vanishing;
    # the shift keeps the digits of data far from the origin (georeferenced coordinates).
    origin, unit = _origin_and_unit(data)
    z = (data / unit - origin) @ factor
    centers = np.zeros((n_clusters, n_columns))
    objective: list[float] = []
    converged = False
    while len(objective) < max_iter and not converged:
        centers = _update_centers(z, u, m, centers)
        change, value = _update_memberships(z, u, m, centers)
        objective.append(value)
        converged = change < tol
    with np.errstate(over="ignore"):  # the square of a very large unit is documented as infinite
        values = np.array(objective) * np.square(np.float64(unit))
    return FuzzyPartition(
        centers=(np.linalg.solve(factor.T, centers.T).T + origin) * unit,
        memberships=u,
        objective=values,
        n_iter=len(objective),
        converged=converged,
    )


def row_chunks(n_rows: int, n_columns: int) -> Iterator[slice]:
    """Yield consecutive row slices whose (rows, n_columns) temporaries have a bounded size."""
    step = max(1, CHUNK_ELEMENTS // max(1, n_columns))
    for start in range(0, n_rows, step):
        yield slice(start, min(start + step, n_rows))


def partition_memberships(
    x: NDArray[np.float64], centers: NDArray[np.float64], m: float = 2.0
) -> NDArray[np.float64]:
    """Give the (n, c) memberships of rows in fixed centres, equations (3) to (5)."""
    u = np.zeros((len(x), len(centers)))
    for rows in row_chunks(len(x), len(centers)):
        u[rows] = _memberships(_squared_distances(x[rows], centers), m)
    return u


def _update_centers(
    z: NDArray[np.float64], u: NDArray[np.float64], m: float, previous: NDArray[np.float64]
) -> NDArray[np.float64]:
    weighted = np.zeros_like(previous)
    weight = np.zeros(len(previous))
    for rows in row_chunks(len(z), len(previous)):
        u_m = u[rows] ** m
        weighted += u_m.T @ z[rows]
        weight += u_m.sum(axis=0)
    owned = weight > 0.0
    centers = previous.copy()
    centers[owned] = weighted[owned] / weight[owned, None]  # Eq. (2)
    return centers


def _update_memberships(
    z: NDArray[np.float64], u: NDArray[np.float64], m: float, centers: NDArray[np.float64]
) -> tuple[float, float]:
    """Overwrite `u` by its next value; give the largest change and the objective."""
    change = 0.0
    objective = 0.0
    for rows in row_chunks(len(z), len(centers)):
        d2 = _squared_distances(z[rows], centers)
        new = _memberships(d2, m)
        change = max(change, float(np.abs(new - u[rows]).max()))  # Eq. (6)
        objective += float(np.sum(new**m * d2))  # Eq. (1)
        u[rows] = new
    return change, objective


def _memberships(d2: NDArray[np.float64], m: float) -> NDArray[np.float64]:
    nearest = d2.min(axis=1, keepdims=True)
    zero = d2 == 0.0  # Eq. (3); its complement is eq. (4)
    # Ratios to the nearest centre are at most one, so no power overflows when m is close to 1.
    ratio = np.divide(nearest, d2, out=np.ones_like(d2), where=~zero)
    if m != 2.0:
        ratio **= 1.0 / (m - 1.0)
    closeness = np.where(nearest == 0.0, zero, ratio)
    u: NDArray[np.float64] = closeness / closeness.sum(axis=1, keepdims=True)  # Eq. (5)
    return u


def _squared_distances(z: NDArray[np.float64], centers: NDArray[np.float64]) -> NDArray[np.float64]:
    # Differences, not the expanded square: that loses the small distances to cancellation.
    d2 = np.zeros((len(z), len(centers)))
    for column in range(z.shape[1]):
        difference = z[:, column, None] - centers[:, column]
        d2 += np.square(difference, out=difference)
    return d2


def _origin_and_unit(data: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    largest = float(np.abs(data).max())
    if largest == 0.0:
        return np.zeros(data.shape[1]), 1.0
    first = 2.0 ** float(np.clip(np.frexp(largest)[1], -1000, 1000))
    spread = float(np.ptp(data / first, axis=0).max())
    unit = first * 2.0 ** float(np.frexp(spread)[1]) if spread > 0.0 else first
    return np.mean(data / unit, axis=0), unit


def _check_data(x: ArrayLike) -> NDArray[np.float64]:
    data = np.ascontiguousarray(x, dtype=np.float64)
    if data.ndim != 2 or data.shape[1] < 1:
        raise ValueError(f"x: expected an array of shape (n, d), d >= 1, got {data.shape}")
    if not np.isfinite(data).all():
        raise ValueError("x: expected finite values, got NaN or infinity")
    return data


def _check_options(n_rows: int, n_clusters: int, m: float, tol: float, max_iter: int) -> None:
    if not isinstance(n_clusters, (int, np.integer)) or not 2 <= n_clusters < n_rows:
        raise ValueError(
            f"n_clusters: expected an integer with 2 <= n_clusters < n = {n_rows}, "
            f"got {n_clusters!r}"
        )
    if not (np.isfinite(m) and m > 1.0):
        raise ValueError(f"m: expected a finite number greater than 1, got {m!r}")
    if not (np.isfinite(tol) and tol >= 0.0):
        raise ValueError(f"tol: expected a finite number >= 0, got {tol!r}")
    if not isinstance(max_iter, (int, np.integer)) or max_iter < 1:
        raise ValueError(f"max_iter: expected an integer >= 1, got {max_iter!r}")


def _metric_factor(metric: ArrayLike | None, n_columns: int) -> NDArray[np.float64]:
    """Give L with A = L L^T, so that the distance is Euclidean between rows of x L."""
    if metric is None:
        return np.eye(n_columns)
    matrix = np.asarray(metric, dtype=np.float64)
    if matrix.shape != (n_columns, n_columns) or not np.isfinite(matrix).all():
        raise ValueError(
            f"metric: expected a finite ({n_columns}, {n_columns}) matrix, got shape {matrix.shape}"
        )
    if not np.allclose(matrix, matrix.T, rtol=1e-12, atol=0.0):
        raise ValueError("metric: expected a symmetric matrix, got an asymmetric one")
    try:
        return np.asarray(np.linalg.cholesky(matrix), dtype=np.float64)
    except np.linalg.LinAlgError:
        smallest = float(np.linalg.eigvalsh(matrix)[0])
        raise ValueError(
            f"metric: expected a positive definite matrix, got smallest eigenvalue {smallest:g}"
        ) from None


def _check_memberships(
    memberships: ArrayLike, n_rows: int, n_clusters: int, m: float
) -> NDArray[np.float64]:
    u = np.array(memberships, dtype=np.float64)
    if u.shape != (n_rows, n_clusters):
        raise ValueError(f"memberships: expected shape {(n_rows, n_clusters)}, got {u.shape}")
    if not (np.isfinite(u).all() and (u >= 0.0).all()):
        raise ValueError("memberships: expected finite values >= 0, got others")
    sums = u.sum(axis=1)
    if not np.allclose(sums, 1.0, rtol=0.0, atol=1e-6):
        worst = float(sums[np.abs(sums - 1.0).argmax()])
        raise ValueError(f"memberships: expected rows that sum to one, got a sum of {worst:g}")
    if not ((u**m).sum(axis=0) > 0.0).all():
        raise ValueError("memberships: expected a member in every cluster, got an empty cluster")
    return u
