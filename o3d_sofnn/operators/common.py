"""What both operators do with what they are given, and how they warn."""

from __future__ import annotations

import contextlib
import logging
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import adapters, validation
from o3d_sofnn.progress import ProgressCallback, make_bar
from o3d_sofnn.results import left_out

_logger = logging.getLogger("o3d_sofnn")
# Warnings are seen without a log; who wants them there, too, gives the log a handler.
_logger.addHandler(logging.NullHandler())


class ReconstructionWarning(UserWarning):
    """A result is doubtful: what was seen, and what to do."""


def warn(*texts: str) -> None:
    """Warn the caller of the operator, and the log."""
    for text in texts:
        _logger.warning(text)
        warnings.warn(text, ReconstructionWarning, stacklevel=3)


def inform(text: str) -> None:
    """Tell the log."""
    _logger.info(text)


@contextlib.contextmanager
def progress_of(print_progress: bool | ProgressCallback) -> Iterator[ProgressCallback | None]:
    """Give what reports progress: a bar, what the user has given, or None."""
    if callable(print_progress):
        yield print_progress
    elif validation.check_flag(print_progress, "print_progress", "True, False or a callable"):
        with contextlib.closing(make_bar()) as bar:
            yield bar
    else:
        yield None


def finite_points(cloud: adapters.CloudArrays) -> NDArray[np.bool_]:
    """Return the mask of finite points; too few of them are an error, some missing a warning."""
    finite = validation.finite_rows(cloud.points)
    count = int(np.count_nonzero(finite))
    validation.check_point_count(count, "pcd")
    validation.check_magnitude(rows_of(cloud.points, finite), "pcd")
    if count < len(finite):
        warn(left_out(finite))
    return finite


def own_normals(cloud: adapters.CloudArrays, finite: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the normals of a cloud; a ``ValueError`` where it has none that can be used."""
    if cloud.normals is None:
        raise ValueError("use_normals: expected a cloud with normals, got one without")
    bad = int(np.count_nonzero(finite & ~validation.finite_rows(cloud.normals)))
    if bad:
        raise ValueError(f"use_normals: expected finite normals, got {bad} rows with NaN or inf")
    if not cloud.normals[finite].any():
        raise ValueError("use_normals: expected normals, got zero vectors only")
    return cloud.normals


def neighborhood(
    search_param: Any, max_nn: int | None, radius: float | None
) -> tuple[int | None, float | None]:
    """Return the largest neighbourhood that a user allows, in points and as a radius."""
    if search_param is None:
        return max_nn, radius
    validation.check_exclusive(search_param=search_param, max_nn=max_nn)
    validation.check_exclusive(search_param=search_param, radius=radius)
    return adapters.read_search_param(search_param)


def rows_of(array: NDArray[np.float64], mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return some rows, without a copy where that is all of them."""
    return array if mask.all() else array[mask]
