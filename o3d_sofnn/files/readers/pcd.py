"""PCD: ascii, binary and binary_compressed, any types of fields, padding between them."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.files import columns
from o3d_sofnn.files.columns import Array, PointFile
from o3d_sofnn.files.readers.lines import Lines, as_text, check_end, excerpt, read_table
from o3d_sofnn.files.regular import bytes_left, open_regular, read_records

_KINDS = {"F": "f", "I": "i", "U": "u"}


_SIZES = {"F": (4, 8), "I": (1, 2, 4, 8), "U": (1, 2, 4, 8)}


_KEYWORDS = frozenset(
    ["VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA"]
)


_LONGEST_LINE = 65536


# A field with this name is room between others.
_PADDING = "_"


@dataclass(frozen=True)
class _Header:
    """What the header says.

    Attributes
    ----------
    fields : list of (name, type, values a point)
    count : int
        Points.
    shape : (int, int) or None
        Rows and columns of an organised cloud.
    viewpoint : numpy.ndarray, shape (3,), or None
    data : str
        ascii, binary or binary_compressed.
    lines : int
        Lines of the header.
    """

    fields: list[tuple[str, str, int]]
    count: int
    shape: tuple[int, int] | None
    viewpoint: Array | None
    data: str
    lines: int

    @property
    def dtype(self) -> np.dtype[Any]:
        """One point in a binary file; fields are numbered, since two may have the same name."""
        return np.dtype(
            [(str(i), kind, (count,)) for i, (_, kind, count) in enumerate(self.fields)]
        )


def read_pcd(path: Path) -> PointFile:
    """Read all fields; VIEWPOINT, unless it is the origin, is the scanner's place.

    Raises
    ------
    OSError
        The file cannot be opened.
    ValueError
        The file is not PCD, has no x y z, or fewer points than its header says.
    """
    with open_regular(path) as stream:
        header = _read_header(stream, path)
        if header.data == "ascii":
            parts = _read_ascii(stream, header, path)
        elif header.data == "binary":
            data = read_records(stream, path, header.count, header.dtype.itemsize)
            records = np.frombuffer(data, header.dtype)
            parts = [records[name] for name in header.dtype.names or ()]
        else:
            parts = _read_compressed(stream, header, path)
    if header.data == "ascii":
        check_end(path)
    found, notes = _columns(header, parts)
    return columns.from_columns(path, found, notes, viewpoint=header.viewpoint, shape=header.shape)


def _read_header(stream: BinaryIO, path: Path) -> _Header:
    entries: dict[str, list[str]] = {}
    for number in itertools.count(1):
        line = stream.readline(_LONGEST_LINE)
        text = line.decode(errors="backslashreplace")
        words = text.split()
        is_comment = not words or words[0].startswith("#")
        if not line.endswith(b"\n") or not (is_comment or words[0].upper() in _KEYWORDS):
            raise ValueError(f"{path}: not readable as PCD: line {number} is {excerpt(text)}")
        if not is_comment:
            entries[words[0].upper()] = words[1:]
        if "DATA" in entries:
            break
    try:
        return _as_header(entries, number)
    except (KeyError, ValueError, OverflowError) as error:
        what = error.args[0] if error.args else "values"
        raise ValueError(f"{path}: not readable as PCD: its header has a fault: {what}") from None


def _as_header(entries: dict[str, list[str]], lines: int) -> _Header:
    """Return the header from the words behind its keywords.

    Raises
    ------
    KeyError, ValueError
        With the keyword that is missing or wrong.
    """
    names, sizes, kinds = entries["FIELDS"], entries["SIZE"], entries["TYPE"]
    counts = entries.get("COUNT", ["1"] * len(names))
    fields = []
    for name, size, kind, count in zip(names, sizes, kinds, counts, strict=True):
        if _natural(size, "SIZE") not in _SIZES.get(kind.upper(), ()):
            raise ValueError(f"TYPE {kind} SIZE {size}")
        # 3D features, such as histograms, have some hundred values.
        fields.append((name, f"<{_KINDS[kind.upper()]}{size}", _natural(count, "COUNT", 65536)))
    width = _natural(" ".join(entries["WIDTH"]), "WIDTH")
    height = _natural(" ".join(entries["HEIGHT"]), "HEIGHT")
    points = _natural(" ".join(entries.get("POINTS", [str(width * height)])), "POINTS")
    if points != width * height:
        raise ValueError(f"POINTS {points} of WIDTH {width} x HEIGHT {height}")
    place = [float(word) for word in entries.get("VIEWPOINT", [])[:3]]
    [data] = entries["DATA"]
    if data.lower() not in ("ascii", "binary", "binary_compressed"):
        raise ValueError(f"DATA {data}")
    return _Header(
        fields,
        points,
        (height, width) if height > 1 else None,
        columns.as_viewpoint(place) if len(place) == 3 else None,
        data.lower(),
        lines,
    )


def _natural(text: str, name: str, most: int = 2**62) -> int:
    if not (text.isdecimal() and text.isascii() and len(text) < 20 and int(text) <= most):
        raise ValueError(f"{name} {excerpt(text)}")
    return int(text)


def _read_ascii(stream: BinaryIO, header: _Header, path: Path) -> list[NDArray[Any]]:
    width = sum(count for _, _, count in header.fields)
    lines = Lines(as_text(stream), path, header.lines)
    rows = itertools.islice((line for line in lines if not line.isspace()), header.count)
    table = read_table(rows, width, lines)
    if len(table) < header.count:
        raise ValueError(f"{path}: cut short: expected {header.count} points, got {len(table)}")
    parts, start = [], 0
    for name, kind, count in header.fields:
        values = table[:, start : start + count]
        start += count
        if kind[1] == "f":
            packed = name in ("rgb", "rgba") and kind == "<f4"
            parts.append(values.astype(kind) if packed else values)
            continue
        limits = np.iinfo(kind)
        if not (
            (values == np.rint(values)) & (values >= limits.min) & (values <= limits.max)
        ).all():
            raise ValueError(f"{path}: field {name}: expected whole numbers of {kind[2:]} bytes")
        parts.append(values.astype(kind))
    return parts


def _read_compressed(stream: BinaryIO, header: _Header, path: Path) -> list[NDArray[Any]]:
    """Read fields one after the other, packed together by LZF."""
    left = bytes_left(stream) - 8
    packed, size = np.frombuffer(read_records(stream, path, 1, 8), "<u4").tolist()
    expected = header.count * header.dtype.itemsize
    # LZF copies at most 264 bytes for 3.
    if packed > left or size != expected or size > 88 * packed:
        raise ValueError(
            f"{path}: cut short: {packed} of {left} packed bytes cannot hold {header.count} points"
        )
    data = _unpack_lzf(stream.read(packed), size)
    if data is None:
        raise ValueError(f"{path}: not readable as PCD: its compressed data are damaged")
    parts, start = [], 0
    for _, kind, count in header.fields:
        values = np.frombuffer(data, kind, header.count * count, start)
        start += values.nbytes
        parts.append(values.reshape(header.count, count))
    return parts


def _unpack_lzf(packed: bytes, size: int) -> bytearray | None:
    """Return the ``size`` bytes that LZF packed; None unless they are so many."""
    out = bytearray()
    at, end = 0, len(packed)
    try:
        while at < end and len(out) <= size:
            control = packed[at]
            at += 1
            if control < 32:  # so many bytes and one as they are
                out += packed[at : at + control + 1]
                at += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += packed[at]
                at += 1
            start = len(out) - ((control & 31) << 8) - packed[at] - 1
            at += 1
            length += 2
            if start < 0:
                return None
            piece = out[start : start + length]
            # What is copied may reach into the copy.
            out += (piece * (length // len(piece) + 1))[:length]
    except IndexError:
        return None
    return out if at == end and len(out) == size else None


def _columns(
    header: _Header, parts: list[NDArray[Any]]
) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Return the fields under their names, packed colours taken apart, padding left out."""
    found: dict[str, NDArray[Any]] = {}
    used = [i for i, (name, _, _) in enumerate(header.fields) if name != _PADDING]
    names = columns.unique_names(header.fields[i][0] for i in used)
    notes = [
        f"a second field {header.fields[i][0]} kept as {name}"
        for i, name in zip(used, names, strict=True)
        if name != header.fields[i][0]
    ]
    for i, name in zip(used, names, strict=True):
        values = parts[i][:, 0] if parts[i].shape[1] == 1 else parts[i]
        if name in ("rgb", "rgba") and values.ndim == 1 and values.dtype.itemsize == 4:
            bits = np.ascontiguousarray(values).view("<u4")
            for color, shift in (("red", 16), ("green", 8), ("blue", 0)):
                found[color] = (bits >> shift & 255).astype(np.uint8)
            if name == "rgba":
                found["alpha"] = (bits >> 24).astype(np.uint8)
        else:
            found[name] = values
    return found, notes
