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
# Warnings are shown without logging; a handler on this logger records them, too.
_logger.addHandler(logging.NullHandler())


class ReconstructionWarning(UserWarning):
    """A result is doubtful; the text says what was noticed, and what to do."""


def warn(*texts: str) -> None:
    """Warn the caller of the operator, and log the warnings."""
    for text in texts:
        _logger.warning(text)
        warnings.warn(text, ReconstructionWarning, stacklevel=3)


@contextlib.contextmanager
def unwarned() -> Iterator[None]:
    """Leave the warnings of operators to the log, for callers that show it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ReconstructionWarning)
        yield


def inform(text: str) -> None:
    """Log a text."""
    _logger.info(text)


@contextlib.contextmanager
def progress_of(print_progress: bool | ProgressCallback) -> Iterator[ProgressCallback | None]:
    """Provide a progress callback: a bar, the user's callable, or None."""
    if callable(print_progress):
        yield print_progress
    elif validation.check_flag(print_progress, "print_progress", "True, False or a callable"):
        with contextlib.closing(make_bar()) as bar:
            yield bar
    else:
        yield None


def finite_points(cloud: adapters.CloudArrays) -> NDArray[np.bool_]:
    """Return the mask of finite points; too few are an error, points left out are a warning."""
    finite = validation.finite_rows(cloud.points)
    count = int(np.count_nonzero(finite))
    validation.check_point_count(count, "pcd")
    validation.check_magnitude(rows_of(cloud.points, finite), "pcd")
    if count < len(finite):
        warn(left_out(finite))
    return finite


def own_box(box: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lower and upper corner, (3,), of a box of Open3D or of an array of both."""
    if hasattr(box, "get_min_bound"):
        low, high = (np.asarray(f(), float) for f in (box.get_min_bound, box.get_max_bound))
    else:
        try:
            low, high = np.asarray(box, float).reshape(2, 3)
        except (TypeError, ValueError):
            raise ValueError(
                "box: expected an AxisAlignedBoundingBox or its lower and upper corner, (2, 3), "
                f"got {type(box).__name__}"
            ) from None
    if not (low <= high).all():
        raise ValueError("box: expected a lower corner below the upper one")
    return low, high


def own_normals(cloud: adapters.CloudArrays, finite: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the normals of a cloud, or raise ``ValueError`` if it has no usable ones."""
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
    """Return the rows in a mask, without a copy if the mask selects all of them."""
    return array if mask.all() else array[mask]
