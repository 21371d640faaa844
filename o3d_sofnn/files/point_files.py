"""Files: read a cloud of any format in its own precision, write whole or not at all."""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import stat
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import adapters
from o3d_sofnn.files import las, readers, writers

_logger = logging.getLogger(__name__)


CLOUD_INPUTS = readers.FORMATS | las.FORMATS


CLOUD_OUTPUTS = frozenset(writers.CLOUD_WRITERS) | las.FORMATS


MESH_OUTPUTS = frozenset(writers.MESH_WRITERS)


# Rounding may move a coordinate by this share of the typical distance between neighbours.
_ROUNDING_SHARE = 0.01


def read_point_cloud(path: str | os.PathLike[str]) -> Any:
    """Read points of any format that Open3D reads, or LAS/LAZ.

    Parameters
    ----------
    path : path-like
        The file; its ending says the format. Of a mesh file the vertices are taken.

    Returns
    -------
    open3d.t.geometry.PointCloud
        In double precision where the file has it, with every attribute per point that the file
        has.

    Raises
    ------
    OSError
        No such file, a folder, no permission.
    ValueError
        An ending that is not known, or contents that cannot be read to the end.
    ImportError
        Open3D or (for LAS/LAZ) laspy is missing; the message says what to type.
    """
    path = Path(path)
    suffix = _check_suffix(path, CLOUD_INPUTS)
    # Open3D's readers take a missing file for an empty one.
    with path.open("rb"):
        pass
    if suffix in las.FORMATS:
        return adapters.make_cloud(las.read_las(path))
    return readers.read_with_open3d(path)


def write_point_cloud(
    path: str | os.PathLike[str], pcd: Any, *, template: str | os.PathLike[str] | None = None
) -> None:
    """Write points, normals and (as far as the format has room) attributes, whole or not at all.

    Parameters
    ----------
    path : path-like
        .ply and .npz keep everything; .las and .laz take normals as extra dimensions; .xyz and
        .xyzn are lines ``x y z nx ny nz``; .pcd is single precision.
    pcd : open3d.geometry.PointCloud or open3d.t.geometry.PointCloud
        The cloud.
    template : path-like, optional
        The file that ``pcd`` was read from: a LAS or LAZ output then keeps what only such a file
        holds (scale, offset, coordinate system). Ignored unless both are LAS or LAZ.

    Raises
    ------
    OSError
        The disk is full, the folder is missing or read-only; ``path`` is then as before.
    ValueError
        An ending that is not known, or a cloud that the format cannot hold.
    """
    path = Path(path)
    suffix = _check_suffix(path, CLOUD_OUTPUTS)
    arrays = adapters.read_cloud(pcd)
    _warn_of_rounding(path, arrays.points)
    source = None if template is None else Path(template)
    if source is not None and source.suffix.lower() not in las.FORMATS:
        source = None
    with open_atomic(path) as stream:
        if suffix in las.FORMATS:
            las.write_las(stream, arrays, compress=suffix == ".laz", template=source)
        else:
            writers.CLOUD_WRITERS[suffix](stream, arrays)


def write_triangle_mesh(path: str | os.PathLike[str], mesh: Any) -> None:
    """Write a mesh with vertex normals and colours, whole or not at all.

    Parameters
    ----------
    path : path-like
        .ply, .obj and .off keep every digit; .stl is single precision without colours.
    mesh : open3d.geometry.TriangleMesh or open3d.t.geometry.TriangleMesh
        The mesh.

    Raises
    ------
    OSError
        The disk is full, the folder is missing or read-only; ``path`` is then as before.
    ValueError
        An ending that is not known.
    """
    path = Path(path)
    suffix = _check_suffix(path, MESH_OUTPUTS)
    vertices, triangles = adapters.read_mesh(mesh)
    _warn_of_rounding(path, vertices.points)
    with open_atomic(path) as stream:
        writers.MESH_WRITERS[suffix](stream, vertices, triangles)


def check_output(path: str | os.PathLike[str], endings: Collection[str]) -> None:
    """Raise what writing to ``path`` would raise, before the work of hours is done.

    Parameters
    ----------
    path : path-like
        The file to be written.
    endings : collection of str
        The endings that are allowed, ``CLOUD_OUTPUTS`` or ``MESH_OUTPUTS``; empty allows any.

    Raises
    ------
    OSError
        The folder is missing or not writable.
    ValueError
        An ending that is not allowed, or ``path`` is no regular file.
    """
    path = Path(path)
    if endings:
        _check_suffix(path, endings)
    stream, name = _create_beside(_target(path))
    stream.close()
    name.unlink()


@contextlib.contextmanager
def open_atomic(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a binary stream whose contents appear at ``path`` when the block ends without error.

    Written under a temporary name in the same folder, flushed to the disk, then renamed. Whatever
    ends the block early, Ctrl-C included, removes the temporary file and leaves ``path`` alone.

    Parameters
    ----------
    path : path-like
        The file to be written or replaced; a link is followed.

    Yields
    ------
    binary stream
        For writing; seekable.

    Raises
    ------
    OSError
        The folder is missing or not writable, or the disk is full.
    ValueError
        ``path`` exists and is no regular file.
    """
    target = _target(Path(path))
    stream, name = _create_beside(target)
    try:
        with stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(name, target)
    except BaseException as error:
        name.unlink(missing_ok=True)
        if isinstance(error, OSError):
            _rename_in_message(error, target)
        raise


def _target(path: Path) -> Path:
    """Follow links, and refuse what a rename would destroy (a device, a folder)."""
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        kind = "a folder" if target.is_dir() else "a device or pipe"
        raise ValueError(f"{path}: expected a regular file or a new name, got {kind}")
    return target


def _create_beside(target: Path) -> tuple[BinaryIO, Path]:
    """Create a hidden file in the folder of ``target``, with the rights that ``target`` has."""
    name = target.with_name(f".{target.name[:100]}.{secrets.token_hex(4)}.part")
    try:
        stream = name.open("x+b")
    except OSError as error:
        _rename_in_message(error, target)
        raise
    if target.exists():
        name.chmod(stat.S_IMODE(target.stat().st_mode))
    return stream, name


def _rename_in_message(error: OSError, target: Path) -> None:
    """Let the message name the file that the user asked for, not the temporary one or none."""
    error.filename = str(target)
    del error.filename2  # None would be a second name


def _check_suffix(path: Path, endings: Collection[str]) -> str:
    suffix = path.suffix.lower()
    if suffix not in endings:
        known = " ".join(sorted(endings))
        raise ValueError(f"{path}: expected one of the endings {known}, got {suffix or 'none'}")
    return suffix


def _warn_of_rounding(path: Path, points: NDArray[np.float64]) -> None:
    """Say so when single precision would visibly move the points of a large-coordinate cloud."""
    finite = points[np.isfinite(points).all(axis=1)]
    if path.suffix.lower() not in writers.SINGLE_PRECISION or len(finite) == 0:
        return
    rounding = float(np.spacing(np.abs(finite).max().astype(np.float32)))
    # Points on a surface: their number grows with the square of extent / spacing.
    spacing = float(np.ptp(finite, axis=0).max()) / np.sqrt(len(finite))
    if rounding > _ROUNDING_SHARE * spacing:
        _logger.warning(
            "%s: single precision rounds these coordinates to %.3g; .ply keeps them", path, rounding
        )
