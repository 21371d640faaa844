"""Results for finite points, brought to the rows of the user's cloud."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from .results import NormalEstimate, SurfaceEstimate


def left_out(finite: NDArray[np.bool_]) -> str:
    """Say how many points are not finite."""
    bad = len(finite) - int(np.count_nonzero(finite))
    return f"{bad} of {len(finite)} points are not finite (NaN or inf) and were left out"


def scatter_normals(estimate: NormalEstimate, finite: NDArray[np.bool_]) -> NormalEstimate:
    """Bring per-point arrays to the user's rows, those without finite coordinates included.

    Parameters
    ----------
    estimate : NormalEstimate
        Of the f finite points.
    finite : (n,) bool
        Which of the user's points they are. The others get the normal (0, 0, 0), the confidence 0
        and the noise NaN, count as outliers, and are mentioned in a warning.
    """
    if finite.all():
        return estimate

    def spread(values: NDArray[Any], missing: Any) -> NDArray[Any]:
        full = np.full((len(finite), *values.shape[1:]), missing, dtype=values.dtype)
        full[finite] = values
        return full

    return dataclasses.replace(
        estimate,
        normals=spread(estimate.normals, 0.0),
        confidence=spread(estimate.confidence, 0.0),
        outliers=spread(estimate.outliers, True),
        noise=spread(estimate.noise, np.nan),
        warnings=(*estimate.warnings, left_out(finite)),
    )


def scatter_surface(estimate: SurfaceEstimate, finite: NDArray[np.bool_]) -> SurfaceEstimate:
    """Do the same for the normals and the weights of a surface."""
    if finite.all():
        return estimate
    return dataclasses.replace(
        estimate,
        normals=scatter_normals(estimate.normals, finite),
        weigh=functools.partial(_scatter_weights, estimate.weigh, finite),
    )


def _scatter_weights(
    weigh: Callable[[], scipy.sparse.csr_matrix], finite: NDArray[np.bool_]
) -> scipy.sparse.csr_matrix:
    weights = weigh()
    return scipy.sparse.csr_matrix(
        (weights.data, np.flatnonzero(finite)[weights.indices], weights.indptr),
        shape=(weights.shape[0], len(finite)),
    )
