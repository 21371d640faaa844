"""LAS and LAZ through laspy, in double precision."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.files.writers import color_levels

FORMATS = frozenset({".las", ".laz"})


_NORMAL_DIMENSIONS = ("NormalX", "NormalY", "NormalZ")


_NOT_ATTRIBUTES = frozenset({"X", "Y", "Z", "red", "green", "blue", *_NORMAL_DIMENSIONS})


def read_las(path: Path) -> CloudArrays:
    """Return the points of a LAS or LAZ file with all their dimensions.

    Parameters
    ----------
    path : pathlib.Path
        The file.

    Returns
    -------
    CloudArrays
        Coordinates in the file's unit; "colors" as 16-bit levels; normals from the extra
        dimensions NormalX, NormalY, NormalZ when present; other dimensions under their names.

    Raises
    ------
    ValueError
        The file is not LAS or LAZ, or cut short.
    ImportError
        laspy is not installed.
    """
    data = _open(path)
    names = set(data.point_format.dimension_names)
    attributes = {
        name: np.asarray(data[name])[:, np.newaxis] for name in sorted(names - _NOT_ATTRIBUTES)
    }
    if {"red", "green", "blue"} <= names:
        attributes["colors"] = np.stack([data.red, data.green, data.blue], axis=1)
    normals = None
    if names.issuperset(_NORMAL_DIMENSIONS):
        normals = np.stack([data[name] for name in _NORMAL_DIMENSIONS], axis=1).astype(np.float64)
    return CloudArrays(np.stack([data.x, data.y, data.z], axis=1), normals, attributes)


def write_las(stream: BinaryIO, cloud: CloudArrays, compress: bool, template: Path | None) -> None:
    """Write points and normals (extra dimensions NormalX, NormalY, NormalZ in double).

    Parameters
    ----------
    stream : binary stream
        Where to write; seekable.
    cloud : CloudArrays
        Finite coordinates, and normals.
    compress : bool
        True for LAZ.
    template : pathlib.Path or None
        A LAS or LAZ file with the same points in the same order: everything in it (scale, offset,
        coordinate system, all dimensions) is kept. None writes LAS 1.4 with coordinates rounded
        to the finest power of ten that 32 bits hold over the extent.

    Raises
    ------
    ValueError
        Coordinates that are not finite, or another number of points than in ``template``.
    ImportError
        laspy is not installed.
    """
    data = _new(cloud) if template is None else _open(template)
    if len(data.points) != len(cloud.points):
        raise ValueError(
            f"pcd: expected the {len(data.points)} points of {template}, got {len(cloud.points)}"
        )
    if cloud.normals is not None:
        laspy = _import_laspy()
        missing = [n for n in _NORMAL_DIMENSIONS if n not in data.point_format.dimension_names]
        data.add_extra_dims([laspy.ExtraBytesParams(name, "f8") for name in missing])
        for name, values in zip(_NORMAL_DIMENSIONS, cloud.normals.T, strict=True):
            data[name] = values
    # In memory first: on a full disk the compressor would hide the reason.
    packed = io.BytesIO()
    data.write(packed, do_compress=compress)
    stream.write(packed.getbuffer())


def _new(cloud: CloudArrays) -> Any:
    laspy = _import_laspy()
    if not np.isfinite(cloud.points).all():
        raise ValueError("pcd: expected finite coordinates for LAS, got NaN or inf")
    colors = color_levels(cloud, "u2")
    header = laspy.LasHeader(version="1.4", point_format=6 if colors is None else 7)
    low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
    header.offsets = np.floor(low)
    steps = 2.0**31 - 1
    header.scales = 10.0 ** np.ceil(np.log10(np.maximum(high - header.offsets, 1e-6) / steps))
    data = laspy.LasData(header)
    data.x, data.y, data.z = cloud.points.T
    if colors is not None:
        data.red, data.green, data.blue = colors.T
    return data


def _open(path: Path) -> Any:
    laspy = _import_laspy()
    with path.open("rb") as stream:
        declared = None
        try:
            with laspy.open(stream, closefd=False) as reader:
                declared = reader.header.point_count
                data = reader.read()
        except (laspy.errors.LaspyException, ValueError, RuntimeError, EOFError) as error:
            raise ValueError(f"{path}: not readable as LAS or LAZ: {error}") from error
    if len(data.points) != declared:
        raise ValueError(f"{path}: cut short: {len(data.points)} of {declared} points")
    return data


def _import_laspy() -> Any:
    try:
        import laspy
    except ModuleNotFoundError as error:
        raise ImportError(
            'LAS and LAZ files need laspy; type: pip install "laspy[lazrs]"'
        ) from error
    return laspy
