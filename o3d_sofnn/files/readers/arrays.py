"""NumPy's npy and npz: Open3D's names of arrays, structured arrays, or any one (n, 3) array."""

from __future__ import annotations

import ast
import errno
import math
import struct
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.files import columns
from o3d_sofnn.files.columns import PointFile, as_rows, storable
from o3d_sofnn.files.regular import bytes_left, open_regular, too_large

_MAGIC = b"\x93NUMPY"


_LONGEST_HEADER = 10_000


# Names of the coordinates, the best first.
_POSITIONS = ("positions", "points", "xyz", "vertices", "coordinates", "coords", "pts")


_COLORS = ("colors", "rgb", "color")


def read_npy(path: Path) -> PointFile:
    """Read an (n, 3) array, or one with named columns x y z and others.

    Raises
    ------
    OSError
        The file cannot be opened.
    ValueError
        The file contains another array, or is cut short.
    """
    with open_regular(path) as stream:
        array = _read_array(stream, bytes_left(stream), path)
    if array.dtype.names:
        found = {name: array[name].reshape(len(array), -1) for name in array.dtype.names}
        flat = {name: v[:, 0] if v.shape[1] == 1 else v for name, v in found.items()}
        return columns.from_columns(path, flat)
    return _from_arrays(path, {"positions": array}, [])


def read_npz(path: Path) -> PointFile:
    """Read the coordinates (positions, points ... or the only (n, 3) array) and all per point.

    Raises
    ------
    OSError
        The file cannot be opened.
    ValueError
        There are no such arrays, the file is damaged, or it would unpack to an implausible size.
    """
    arrays: dict[str, NDArray[Any]] = {}
    notes: list[str] = []
    with open_regular(path) as stream:
        left = bytes_left(stream)
        try:
            with zipfile.ZipFile(stream) as archive:
                members = archive.infolist()
                if too_large(sum(member.file_size for member in members), left):
                    raise ValueError(
                        f"{path}: refused: it would unpack to {_gigabytes(members)} GB"
                    )
                for member in members:
                    name = member.filename.removesuffix(".npy")
                    is_usual = member.compress_type in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
                    if name == member.filename or name in arrays or not is_usual:
                        notes.append(f"{member.filename!r} left out: no array")
                        continue
                    with archive.open(member) as entry:
                        arrays[name] = _read_array(entry, member.file_size, path)
        except (
            zipfile.BadZipFile, zlib.error, struct.error, EOFError, LookupError, ArithmeticError,
            NotImplementedError, RuntimeError,
        ) as error:  # fmt: skip
            raise ValueError(f"{path}: not readable as npz: {error}") from error
        except OSError as error:
            # A damaged directory of the archive points to before the beginning of the file.
            if error.errno != errno.EINVAL:
                raise
            raise ValueError(f"{path}: not readable as npz: a damaged directory") from error
    return _from_arrays(path, arrays, notes)


def _gigabytes(members: list[zipfile.ZipInfo]) -> float:
    return round(sum(member.file_size for member in members) / 2**30, 1)


def _read_array(stream: IO[bytes], size: int, path: Path) -> NDArray[Any]:
    """Return the array of a stream of ``size`` bytes; what it says of itself must fit in there."""
    head = stream.read(8)
    if not head.startswith(_MAGIC) or head[6:7] not in (b"\1", b"\2", b"\3"):
        raise ValueError(f"{path}: not readable as npy: no array of NumPy")
    length = int.from_bytes(stream.read(2 if head[6] == 1 else 4), "little")
    if length > _LONGEST_HEADER:
        raise ValueError(f"{path}: not readable as npy: a header of {length} bytes")
    text = stream.read(length)
    try:
        entries = ast.literal_eval(text.decode("latin-1").strip())
        kind, shape = np.dtype(entries["descr"]), tuple(entries["shape"])
        count = math.prod(shape)
        if not all(type(side) is int and side >= 0 for side in shape):
            raise ValueError("sides that are no numbers")
    except (ValueError, SyntaxError, TypeError, LookupError, MemoryError, RecursionError) as error:
        raise ValueError(f"{path}: not readable as npy: a damaged header") from error
    if kind.hasobject:
        raise ValueError(f"{path}: refused: an array of Python objects, which may run code")
    if count * kind.itemsize > size:
        raise ValueError(f"{path}: cut short: an array of {count * kind.itemsize} bytes in {size}")
    data = stream.read(count * kind.itemsize)
    if len(data) < count * kind.itemsize:
        raise ValueError(f"{path}: cut short: an array of {count * kind.itemsize} bytes")
    array = np.frombuffer(data, kind, count) if data else np.zeros(count, kind)
    if entries.get("fortran_order") is True:
        return array.reshape(shape[::-1]).T
    return array.reshape(shape)


def _from_arrays(path: Path, arrays: dict[str, NDArray[Any]], notes: list[str]) -> PointFile:
    """Return the contents of a file from its arrays; what has no row per point is left out."""
    threes = [name for name, values in arrays.items() if values.shape[1:] == (3,)]
    known = [name for name in _POSITIONS if name in threes]
    if not known and len(threes) != 1:
        what = " ".join(f"{name}{values.shape}" for name, values in arrays.items())[:200] or "none"
        raise ValueError(f"{path}: expected one array of shape (n, 3), got {what}")
    position = (known or threes)[0]
    points = storable(arrays[position])
    if points is None:
        raise ValueError(f"{path}: expected numbers, got {arrays[position].dtype}")
    normals = None
    attributes: dict[str, NDArray[Any]] = {}
    for name, values in arrays.items():
        stored = storable(values) if values.shape[:1] == points.shape[:1] else None
        if name == position:
            continue
        if stored is None:
            notes.append(f"{name!r} left out: {values.dtype}{values.shape} is no number per point")
        elif name == "normals" and stored.shape[1] == 3:
            normals = as_rows(stored)
        elif name in _COLORS and stored.shape[1] == 3 and "colors" not in attributes:
            colors = columns.color_levels_of(stored)
            kept = columns.free_name(name, attributes) if colors is None else "colors"
            attributes[kept] = stored if colors is None else colors
        else:
            attributes[columns.free_name(name, attributes)] = stored
    return PointFile(as_rows(points), normals, attributes, notes=tuple(notes))
