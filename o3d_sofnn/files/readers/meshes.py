"""OFF and STL: vertices in double, with or without faces."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from o3d_sofnn.files import columns, triangles
from o3d_sofnn.files.columns import Array, PointFile
from o3d_sofnn.files.readers.lines import NO_ROW, Lines, check_end, excerpt, open_text, read_table
from o3d_sofnn.files.regular import bytes_left, open_regular
from o3d_sofnn.files.triangles import Triangles

_COORDINATES, _COLORS, _NORMALS = ("x", "y", "z"), ("red", "green", "blue"), ("nx", "ny", "nz")


_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


_STL_HEAD = 80


def read_off(path: Path) -> PointFile:
    """Read the vertices of OFF, COFF, NOFF or CNOFF with what they have.

    Raises
    ------
    OSError
        The file cannot be opened.
    ValueError
        The file is not OFF in text, or has fewer vertices than it says.
    """
    return _read_off(path, wants_faces=False)[0]


def read_off_mesh(path: Path) -> tuple[Array, Triangles]:
    """Read the (m, 3) vertices and the (f, 3) triangles."""
    vertices, faces = _read_off(path, wants_faces=True)
    return vertices.points, faces


def _read_off(path: Path, wants_faces: bool) -> tuple[PointFile, Triangles]:
    with open_text(path) as stream:
        lines = Lines(stream, path)
        rows = (text for text in (line.partition("#")[0].strip() for line in lines) if text)
        kind, *counts = next(rows, "").split() or [""]
        has_colors, has_normals = "C" in kind, "N" in kind
        if kind not in ("OFF", "COFF", "NOFF", "CNOFF"):
            raise lines.fault("OFF, COFF, NOFF or CNOFF in text")
        counts = counts or next(rows, "").split()
        if not (2 <= len(counts) <= 3 and all(text.isdecimal() for text in counts)):
            raise lines.fault("numbers of vertices, faces and edges")
        vertices, faces = (int(text[:18]) for text in counts[:2])
        vertex_rows = itertools.islice(rows, vertices)
        first = next(vertex_rows, "")
        width = len(first.split())
        names = [*_COORDINATES, *(_NORMALS if has_normals else ())]
        # Many programs write colours without saying so.
        if has_colors or width - len(names) in (3, 4):
            names += [*_COLORS, "alpha"][: width - len(names)]
        table = np.zeros((0, len(names)))
        if vertices:
            table = read_table(itertools.chain([first], vertex_rows), len(names), lines)
        if len(table) < vertices:
            raise ValueError(f"{path}: cut short: expected {vertices} points, got {len(table)}")
        found = _off_faces(rows, faces, lines) if wants_faces else np.zeros((0, 3), np.int64)
    if faces == 0:
        check_end(path)
    file = columns.from_columns(path, dict(zip(names, table.T, strict=True)))
    return file, triangles.checked(found, vertices, path)


def _off_faces(rows: Iterator[str], count: int, lines: Lines) -> Triangles:
    taken = list(itertools.islice(rows, count))
    if len(taken) < count:
        raise lines.fault(f"{count} faces")
    width = len(taken[0].split()) if taken else 0
    try:
        table = read_table(taken, width, lines)
    except ValueError:
        table = None
    if table is not None and len(table) and (table[:, 0] == table[0, 0]).all():
        length = int(table[0, 0])
        if 0 <= length < width:
            corners = table[:, 1 : length + 1].astype(np.int64).ravel()
            return triangles.from_polygons(np.full(count, length), corners)
    return _walk_off_faces(taken, lines)


def _walk_off_faces(rows: list[str], lines: Lines) -> Triangles:
    """Read faces with different numbers of corners, or with colours behind some of them."""
    counts: list[int] = []
    corners: list[int] = []
    for row in rows:
        try:
            length, *words = row.split()
            numbers = [int(word) for word in words[: int(length)]]
        except ValueError:
            raise lines.fault("faces") from None
        if int(length) != len(numbers) or max(map(abs, numbers), default=0) > 2**62:
            raise lines.fault("faces")
        counts.append(len(numbers))
        corners += numbers
    return triangles.from_polygons(np.array(counts, int), np.array(corners, int))


def read_stl(path: Path) -> PointFile:
    """Read the corners of all facets, each place once.

    Raises
    ------
    OSError
        The file cannot be opened.
    ValueError
        The file is not STL, or has fewer facets than it says.
    """
    vertices, _ = read_stl_mesh(path)
    return PointFile(vertices)


def read_stl_mesh(path: Path) -> tuple[Array, Triangles]:
    """Read the (m, 3) vertices, joined, and the (f, 3) triangles."""
    with open_regular(path) as stream:
        size = bytes_left(stream)
        head = stream.read(_STL_HEAD)
        count = int.from_bytes(stream.read(4), "little")
        room = max(size - _STL_HEAD - 4, 0) // _STL_FACET.itemsize
        is_binary = size >= _STL_HEAD + 4 and count == room
        if not is_binary and head.lstrip()[:5].lower() != b"solid":
            raise ValueError(
                f"{path}: not readable as STL: it says {count} facets, it has room for {room}"
            )
        corners = _read_stl_facets(stream, count) if is_binary else None
    if corners is None:
        corners = _read_stl_text(path)
    kept, index = triangles.join_vertices(corners)
    return corners[kept], index.reshape(-1, 3)


def _read_stl_facets(stream: BinaryIO, count: int) -> Array:
    facets = np.frombuffer(stream.read(count * _STL_FACET.itemsize), _STL_FACET)
    return facets["corners"].reshape(-1, 3).astype(np.float64)


def _read_stl_text(path: Path) -> Array:
    with open_text(path) as stream:
        lines = Lines(stream, path)
        seen = {"vertex": 0, "endloop": 0, "endfacet": 0, "endsolid": 0}

        def vertices() -> Iterator[str]:
            for line in lines:
                word, *rest = line.split(None, 1) or [""]
                word = word.lower()
                if word == "endloop" and seen["vertex"] != 3 * (seen["endloop"] + 1):
                    yield f"a facet of three corners, got {excerpt(line)}"
                if word in seen:
                    seen[word] += 1
                if word == "vertex":
                    yield rest[0] if rest else NO_ROW

        corners = read_table(vertices(), 3, lines)
    if seen["endsolid"] == 0 or 3 * seen["endfacet"] != len(corners):
        raise ValueError(f"{path}: cut short: no whole facets up to an 'endsolid'")
    return corners
