"""OBJ, OFF and STL: vertices in double, with or without faces; no other file is opened."""

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


# Columns of a vertex in OBJ.
_OBJ_COLUMNS = {
    3: _COORDINATES,
    4: (*_COORDINATES, "weight"),
    6: (*_COORDINATES, *_COLORS),
    7: (*_COORDINATES, *_COLORS, "alpha"),
}


# Statements of OBJ; a line with another word may be a damaged vertex.
_OBJ_WORDS = frozenset(
    [
        *("v", "vt", "vn", "vp", "f", "l", "p", "g", "o", "s", "mg", "usemtl", "mtllib", "usemap"),
        *("maplib", "cstype", "deg", "bmat", "step", "curv", "curv2", "surf", "parm", "trim"),
        *("hole", "scrv", "sp", "end", "con", "bevel", "c_interp", "d_interp", "lod"),
        *("shadow_obj", "trace_obj", "ctech", "stech", "call", "csh"),
    ]
)


_STL_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


_STL_HEAD = 80


def read_obj(path: Path) -> PointFile:
    """Read vertices with their colours, and normals where each vertex has one of its own.

    Raises
    ------
    OSError
        As of opening a file.
    ValueError
        No OBJ, or a vertex is no row of numbers.
    """
    vertices, unknown = _read_obj_table(path, "v")
    names = _OBJ_COLUMNS.get(vertices.shape[1])
    if names is None or len(vertices) == 0:
        raise ValueError(f"{path}: not readable as OBJ: no lines 'v x y z'")
    found = dict(zip(names, vertices.T, strict=True))
    notes = [f"{unknown} lines left out, which are no statements of OBJ"] if unknown else []
    normals, _ = _read_obj_table(path, "vn")
    if normals.shape == (len(vertices), 3) and _normals_are_of_vertices(path):
        found |= dict(zip(_NORMALS, normals.T, strict=True))
    elif len(normals):
        notes.append("normals left out: they belong to corners of faces")
    check_end(path)
    return columns.from_columns(path, found, notes)


def read_obj_mesh(path: Path) -> tuple[Array, Triangles]:
    """Read the (m, 3) vertices and the (f, 3) triangles."""
    points = read_obj(path).points
    counts: list[int] = []
    corners: list[int] = []
    for face in _obj_faces(path):
        counts.append(len(face))
        corners += [vertex for vertex, _ in face]
    found = triangles.from_polygons(np.array(counts, int), np.array(corners, int))
    return points, triangles.checked(found, len(points), path)


def _read_obj_table(path: Path, word: str) -> tuple[Array, int]:
    """Return the numbers behind ``word``, and how many lines are no statements of OBJ."""
    with open_text(path) as stream:
        lines = Lines(stream, path)
        rows = _Statements(lines)
        values = (rest for kind, rest in rows if kind == word)
        first = next(values, "")
        if not first:
            return np.zeros((0, 3)), rows.unknown
        table = read_table(itertools.chain([first], values), len(first.split()), lines)
        return table, rows.unknown


class _Statements:
    """Iterates over (word, rest of the line), and counts the lines that are no statements."""

    def __init__(self, lines: Lines) -> None:
        self._lines = lines
        self.unknown = 0

    def __iter__(self) -> Iterator[tuple[str, str]]:
        lines = iter(self._lines)
        for line in lines:
            text = line.strip()
            while text.endswith("\\"):
                text = text[:-1] + next(lines, "").strip()
            if not text or text.startswith("#"):
                continue
            word, *rest = text.split(None, 1)
            self.unknown += word not in _OBJ_WORDS
            yield word, rest[0] if rest else NO_ROW


def _obj_faces(path: Path) -> Iterator[list[tuple[int, int]]]:
    """Yield faces as (vertex, normal) from zero; the vertex again where there is no normal."""
    counts = {"v": 0, "vn": 0}
    with open_text(path) as stream:
        lines = Lines(stream, path)
        for word, rest in _Statements(lines):
            if word in counts:
                counts[word] += 1
            elif word == "f":
                try:
                    yield [_obj_corner(text, counts) for text in rest.split()]
                except ValueError:
                    raise lines.fault("a face") from None


def _obj_corner(text: str, counts: dict[str, int]) -> tuple[int, int]:
    vertex, _, rest = text.partition("/")
    normal = rest.partition("/")[2]
    place = _from_zero(vertex, counts["v"])
    return place, _from_zero(normal, counts["vn"]) if normal else place


def _from_zero(text: str, count: int) -> int:
    """Return a number from one, or one below zero that counts from the end, as an index."""
    number = int(text)
    if number == 0 or abs(number) > 2**62:
        raise ValueError
    return number - 1 if number > 0 else count + number


def _normals_are_of_vertices(path: Path) -> bool:
    return all(vertex == normal for face in _obj_faces(path) for vertex, normal in face)


def read_off(path: Path) -> PointFile:
    """Read the vertices of OFF, COFF, NOFF or CNOFF with what they have.

    Raises
    ------
    OSError
        As of opening a file.
    ValueError
        No OFF in text, or fewer vertices than it says.
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
    counts: list[int] = []
    corners: list[int] = []
    for row in itertools.islice(rows, count):
        try:
            length, *numbers = (int(word) for word in row.split()[: int(row.split()[0]) + 1])
        except ValueError:
            raise lines.fault("a face") from None
        if length != len(numbers) or max(map(abs, numbers), default=0) > 2**62:
            raise lines.fault("a face")
        counts.append(length)
        corners += numbers
    if len(counts) < count:
        raise lines.fault(f"{count} faces")
    return triangles.from_polygons(np.array(counts, int), np.array(corners, int))


def read_stl(path: Path) -> PointFile:
    """Read the corners of all facets, each place once.

    Raises
    ------
    OSError
        As of opening a file.
    ValueError
        No STL, or fewer facets than it says.
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
