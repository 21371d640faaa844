"""Contents of a point file, assembled from columns with the names that programs use."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PointFile:
    """The contents of a point file as arrays, in the order of the file.

    Attributes
    ----------
    points : numpy.ndarray, shape (n, 3), float64
        Coordinates in the file's unit, including NaN and infinity.
    normals : numpy.ndarray, shape (n, 3), float64, or None
        Normals, if the file has them.
    attributes : dict of str to numpy.ndarray, shape (n, k)
        Everything else per point in its own number type; "colors" in floating point are fractions
        of full intensity, integers are levels of their type.
    viewpoint : numpy.ndarray, shape (3,) or (n, 3), or None
        Where the scanner stood, in the points' coordinates; one row per point for several scans.
    shape : (int, int) or None
        Rows and columns of the grid that the points come in, row by row.
    crs : str or None
        Coordinate reference system, as WKT or "EPSG:number".
    notes : tuple of str
        One line for everything in the file that was left out or changed.
    """

    points: Array
    normals: Array | None = None
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)
    viewpoint: Array | None = None
    shape: tuple[int, int] | None = None
    crs: str | None = None
    notes: tuple[str, ...] = ()


_COORDINATES = (
    ("x", "y", "z"),
    ("points:0", "points:1", "points:2"),
    ("points_0", "points_1", "points_2"),
    ("easting", "northing", "elevation"),
    ("easting", "northing", "height"),
)


_NORMALS = (
    ("nx", "ny", "nz"),
    ("normal_x", "normal_y", "normal_z"),
    ("normalx", "normaly", "normalz"),
    ("normals:0", "normals:1", "normals:2"),
    ("normals_0", "normals_1", "normals_2"),
)


_COLORS = (
    ("red", "green", "blue"),
    ("r", "g", "b"),
    ("diffuse_red", "diffuse_green", "diffuse_blue"),
    ("rf", "gf", "bf"),
    ("colorred", "colorgreen", "colorblue"),
)


# Gaussian splats: the constant term of each colour's spherical harmonics, and the value of that
# harmonic, 1 / (2 sqrt(pi)).
_HARMONICS = (("f_dc_0", "f_dc_1", "f_dc_2"),)


_CONSTANT_HARMONIC = 0.28209479177387814


# Reserved names of what is stored separately.
_RESERVED = ("positions", "normals", "colors")


# Rounding may move fractions of full intensity slightly out of 0 to 1.
_SHARE_SLACK = 0.01


def from_columns(
    path: Path, columns: Mapping[str, NDArray[Any]], notes: Iterable[str] = (), **rest: Any
) -> PointFile:
    """Return the contents of a file from its columns.

    Parameters
    ----------
    path : pathlib.Path
        The file, for messages.
    columns : mapping of str to numpy.ndarray, shape (n,) or (n, k)
        Columns of equal length; coordinates, normals and colours are recognised by their names, in
        lower or upper case. All others become attributes.
    notes : iterable of str
        Notes of the reader.
    **rest
        ``viewpoint``, ``shape`` and ``crs`` of the result.

    Raises
    ------
    ValueError
        There are no coordinates.
    """
    said = list(notes)
    left = dict(columns)
    coordinates = _take(left, _COORDINATES)
    if coordinates is None:
        names = " ".join(list(columns)[:12]) or "none"
        raise ValueError(f"{path}: expected columns x y z, got {names}")
    normals = _take(left, _NORMALS)
    attributes: dict[str, NDArray[Any]] = {}
    _add_colors(left, attributes, said)
    for name, values in left.items():
        stored = storable(values)
        if stored is None:
            said.append(f"{name!r} left out: {values.dtype} is no type of number per point")
            continue
        kept = free_name(name, attributes)
        if kept != name:
            said.append(f"{name!r} kept as {kept!r}")
        attributes[kept] = stored
    return PointFile(
        as_rows(np.stack(coordinates, axis=1)),
        None if normals is None else as_rows(np.stack(normals, axis=1)),
        attributes,
        notes=tuple(said),
        **rest,
    )


def as_rows(values: NDArray[Any]) -> Array:
    """Return (n, 3) values in double precision, contiguous."""
    return np.ascontiguousarray(values, dtype=np.float64)


def storable(values: NDArray[Any]) -> NDArray[Any] | None:
    """Return (n, k) values in native byte order and a common type; None if they are no numbers."""
    if values.dtype.kind not in "biuf" or values.ndim == 0:
        return None
    if values.dtype.kind == "f" and values.dtype.itemsize not in (4, 8):
        values = values.astype(np.float32 if values.dtype.itemsize < 4 else np.float64)
    flat = values.reshape(len(values), -1 if values.size else 1)
    return np.ascontiguousarray(flat, dtype=flat.dtype.newbyteorder("="))


def has_coordinates(names: Iterable[str]) -> bool:
    """Return whether three of ``names`` are known names of coordinates."""
    known = {name.lower() for name in names}
    return any(known >= set(wanted) for wanted in _COORDINATES)


def as_viewpoint(place: ArrayLike) -> Array | None:
    """Return the position of a scanner; None for the origin, which means unknown."""
    position = np.asarray(place, dtype=np.float64)
    return position if position.any() and np.isfinite(position).all() else None


def free_name(name: str, taken: Iterable[str]) -> str:
    """Return a name for an attribute that is neither taken nor reserved."""
    return unique_names([*_RESERVED, *taken, name])[-1]


def unique_names(names: Iterable[str]) -> list[str]:
    """Return ``names`` with numbers appended to repeated ones."""
    taken: list[str] = []
    for name in names:
        kept, number = name, 1
        while kept in taken:
            number += 1
            kept = f"{name}_{number}"
        taken.append(kept)
    return taken


def color_levels_of(values: NDArray[Any]) -> NDArray[Any] | None:
    """Return colours according to their type or their values; None if neither fits.

    Integers wider than 8 bits, and whole numbers in floating point, are levels of 8 bits if no
    value is above 255: programs write those into columns of any type.
    """
    if values.dtype == np.uint8 or values.size == 0:
        return values
    low, high = np.fmin.reduce(values, axis=None), np.fmax.reduce(values, axis=None)
    is_whole = values.dtype.kind in "iu" or bool((values == np.rint(values)).all())
    if values.dtype.kind == "f" and low >= -_SHARE_SLACK and high <= 1.0 + _SHARE_SLACK:
        return values
    if is_whole and low >= 0 and high <= 65535:
        return values.astype(np.uint8 if high <= 255 else np.uint16)
    return None


def _add_colors(
    left: dict[str, NDArray[Any]], attributes: dict[str, NDArray[Any]], said: list[str]
) -> None:
    """Move colours from the columns to the attributes."""
    found = _find(left, _COLORS)
    if found is not None:
        colors = color_levels_of(np.stack([left[name] for name in found], axis=1))
        if colors is None:
            said.append(f"colours {' '.join(found)} are in no known range: kept as attributes")
        else:
            attributes["colors"] = colors
            for name in found:
                del left[name]
    splats = _find(left, _HARMONICS)
    if splats is not None and "colors" not in attributes:
        terms = np.stack([left[name] for name in splats], axis=1).astype(np.float32)
        shares = 0.5 + np.float32(_CONSTANT_HARMONIC) * terms
        attributes["colors"] = np.nan_to_num(shares).clip(0.0, 1.0)


def _find(
    columns: Mapping[str, NDArray[Any]], known: Iterable[tuple[str, str, str]]
) -> list[str] | None:
    """Return the names of the first three columns that have one of these triples of names."""
    names = {
        name.lower(): name
        for name, values in columns.items()
        if values.ndim == 1 and values.dtype.kind in "biuf"
    }
    for wanted in known:
        if names.keys() >= set(wanted):
            return [names[name] for name in wanted]
    return None


def _take(
    left: dict[str, NDArray[Any]], known: Iterable[tuple[str, str, str]]
) -> list[NDArray[Any]] | None:
    found = _find(left, known)
    return None if found is None else [left.pop(name) for name in found]
