"""Position of the points in a LAS or LAZ file, checked against the file's length."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from o3d_sofnn.files.regular import bytes_left, open_regular, too_large

# Sizes of the header by minor version, and of the heads of records with variable length.
_HEADER_SIZES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375, 5: 393}


_VLR_HEAD, _EVLR_HEAD = 54, 60


# The record that says how points are packed.
_PACKING = (b"laszip encoded", 22204)


# Points that lazrs unpacks at a time.
_BLOCK = 2**16


@dataclass(frozen=True)
class Layout:
    """Position of the points in a file.

    Attributes
    ----------
    offset : int
        Offset of the first point, in bytes.
    count : int
        Number of points.
    record : int
        Bytes per point.
    packing : bytes or None
        Record that describes how LAZ packs them.
    """

    offset: int
    count: int
    record: int
    packing: bytes | None


def read_layout(stream: BinaryIO, path: Path) -> Layout:
    """Read and check the numbers in the header that locate the points."""

    def fault(text: str) -> ValueError:
        return ValueError(f"{path}: not readable as LAS or LAZ: {text}")

    size = bytes_left(stream)
    head = stream.read(max(_HEADER_SIZES.values()))
    if head[:4] != b"LASF" or len(head) < _HEADER_SIZES[0]:
        raise fault("no header of LAS")
    minor = head[25]
    header_size, offset, records = struct.unpack_from("<HII", head, 94)
    kind, record, count = struct.unpack_from("<BHI", head, 104)
    if minor not in _HEADER_SIZES or not _HEADER_SIZES[minor] <= header_size <= offset <= size:
        raise fault("cut short, or of an unknown version")
    found = _read_vlrs(stream, header_size, offset, records)
    if found is None:
        raise fault(f"no room for its {records} records")
    if minor >= 4:
        first, extended, long_count = struct.unpack_from("<QIQ", head, 235)
        count = long_count or count
        if extended and not _have_room(stream, first, size, extended):
            raise fault(f"no room for its {extended} extended records")
    if record == 0:
        raise fault("points of no bytes")
    is_packed = bool(kind & 0xC0)
    if is_packed and (_PACKING not in found or too_large(count * record, size)):
        raise fault(f"{count} packed points in {size} bytes")
    if not is_packed and count * record > size - offset:
        raise ValueError(
            f"{path}: cut short: its header says {count} points, "
            f"it has room for {(size - offset) // record}"
        )
    return Layout(offset, count, record, found.get(_PACKING))


def _read_vlrs(
    stream: BinaryIO, start: int, end: int, count: int
) -> dict[tuple[bytes, int], bytes] | None:
    """Return the records between two offsets by name; None if they do not fit."""
    stream.seek(start)
    data = stream.read(end - start)
    found: dict[tuple[bytes, int], bytes] = {}
    at = 0
    for _ in range(count):
        if at + _VLR_HEAD > len(data):
            return None
        name, number, length = struct.unpack_from("<16sHH", data, at + 2)
        at += _VLR_HEAD
        if at + length > len(data):
            return None
        found[name.rstrip(b"\0"), number] = data[at : at + length]
        at += length
    return found


def _have_room(stream: BinaryIO, start: int, end: int, count: int) -> bool:
    """Return whether ``count`` extended records fit between two offsets."""
    for _ in range(count):
        if start + _EVLR_HEAD > end:
            return False
        stream.seek(start + 20)
        start += _EVLR_HEAD + int.from_bytes(stream.read(8), "little")
    return start <= end


def frames(path: str) -> Iterator[bytes]:
    """Yield the unpacked records of a LAZ file; this runs in the separate process."""
    import lazrs

    with open_regular(Path(path)) as stream:
        layout = read_layout(stream, Path(path))
        if layout.packing is None or lazrs.LazVlr(layout.packing).item_size() != layout.record:
            raise ValueError("its points are packed in another way than its header says")
        stream.seek(layout.offset)
        unpacker = lazrs.ParLasZipDecompressor(stream, layout.packing)
        for start in range(0, layout.count, _BLOCK):
            block = bytearray(min(_BLOCK, layout.count - start) * layout.record)
            unpacker.decompress_many(block)
            yield bytes(block)
