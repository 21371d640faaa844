"""Selection of what a format can hold, and messages about the rest."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.files import columns
from o3d_sofnn.files.writers import formats
from o3d_sofnn.files.writers.origin import local_origin

_logger = logging.getLogger(__name__)


# Rounding may move a coordinate by this share of the typical distance between neighbours.
_ROUNDING_SHARE = 0.01


def free(extra: Mapping[str, NDArray[Any]], taken: Collection[str]) -> dict[str, NDArray[Any]]:
    """Return (n, 1) values under unused names."""
    found: dict[str, NDArray[Any]] = {}
    for name, values in extra.items():
        found[columns.free_name(name, [*taken, *found])] = values.reshape(len(values), -1)
    return found


def named(
    path: Path, extra: Mapping[str, NDArray[Any]], taken: Collection[str]
) -> dict[str, NDArray[Any]]:
    """Do the same, and log which values get another name."""
    found = free(extra, taken)
    for name, kept in zip(extra, found, strict=True):
        if kept != name:
            _logger.warning("%s: has %r already, the new one is %r", path, name, kept)
    return found


def joined(arrays: CloudArrays, further: Mapping[str, NDArray[Any]]) -> CloudArrays:
    """Return the same with further attributes."""
    return replace(arrays, attributes={**arrays.attributes, **further})


def fitted(path: Path, arrays: CloudArrays, keeps: Collection[str] | None) -> CloudArrays:
    """Return what a format can hold, and log the rest; None keeps everything per point."""
    count = len(arrays.points)
    per_point = {name: v for name, v in arrays.attributes.items() if v.shape[:1] == (count,)}
    others = sorted(arrays.attributes.keys() - per_point.keys())
    if others:
        _logger.warning("%s: not kept, as not one per point: %s", path, " ".join(others))
    lost = [] if keeps is None or arrays.normals is None or "normals" in keeps else ["normals"]
    lost += [] if keeps is None else sorted(per_point.keys() - set(keeps))
    if lost:
        _logger.warning("%s: not kept: %s; .ply keeps them", path, " ".join(lost))
    rounded = [name for name, values in per_point.items() if _is_beyond_double(values)]
    if path.suffix.lower() == ".ply" and rounded:
        _logger.warning("%s: rounded to double precision: %s", path, " ".join(rounded))
    return CloudArrays(arrays.points, arrays.normals, per_point)


def _is_beyond_double(values: NDArray[Any]) -> bool:
    """Return whether there are integers that double precision may round."""
    if values.dtype.kind not in "iu" or values.size == 0:
        return False
    return max(int(values.max()), -int(values.min())) > 2**53


def warn_of_rounding(path: Path, points: NDArray[np.float64]) -> None:
    """Warn if single precision would visibly move points with large coordinates."""
    finite = points[np.isfinite(points).all(axis=1)]
    suffix = path.suffix.lower()
    if suffix not in formats.SINGLE_PRECISION or len(finite) == 0:
        return
    if suffix in formats.WITH_ORIGIN:
        finite = finite - local_origin(finite)
    rounding = float(np.spacing(np.abs(finite).max().astype(np.float32)))
    # Points on a surface: their number grows with the square of extent / spacing.
    spacing = float(np.ptp(finite, axis=0).max()) / np.sqrt(len(finite))
    if rounding > _ROUNDING_SHARE * spacing:
        _logger.warning(
            "%s: single precision rounds these coordinates to %.3g; .ply keeps them", path, rounding
        )
