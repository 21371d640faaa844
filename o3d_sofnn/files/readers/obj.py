"""OBJ: vertices in double, with or without faces; no other file is opened."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.files import columns, triangles
from o3d_sofnn.files.columns import Array, PointFile
from o3d_sofnn.files.readers.lines import NO_ROW, Lines, check_end, excerpt, open_text, read_table
from o3d_sofnn.files.triangles import Triangles

Indices = NDArray[np.int64]

_COORDINATES, _COLORS, _NORMALS = ("x", "y", "z"), ("red", "green", "blue"), ("nx", "ny", "nz")


# Columns of a vertex.
_COLUMNS = {
    3: _COORDINATES,
    4: (*_COORDINATES, "weight"),
    6: (*_COORDINATES, *_COLORS),
    7: (*_COORDINATES, *_COLORS, "alpha"),
}


# Statements; a line with another word may be a damaged vertex.
_WORDS = frozenset(
    [
        *("v", "vt", "vn", "vp", "f", "l", "p", "g", "o", "s", "mg", "usemtl", "mtllib", "usemap"),
        *("maplib", "cstype", "deg", "bmat", "step", "curv", "curv2", "surf", "parm", "trim"),
        *("hole", "scrv", "sp", "end", "con", "bevel", "c_interp", "d_interp", "lod"),
        *("shadow_obj", "trace_obj", "ctech", "stech", "call", "csh"),
    ]
)


def read_obj(path: Path) -> PointFile:
    """Read vertices with their colours, and normals where each vertex has one of its own.

    Raises
    ------
    OSError
        The file cannot be opened.
    ValueError
        The file is not OBJ, or a vertex is not a row of numbers.
    """
    vertices = _read_table(path, "v")
    names = _COLUMNS.get(vertices.shape[1])
    if names is None or len(vertices) == 0:
        raise ValueError(f"{path}: not readable as OBJ: no lines 'v x y z'")
    found = dict(zip(names, vertices.T, strict=True))
    unknown = " ".join(_unknown_words(path))
    notes = (
        [f"lines left out, which are no statements of OBJ: {excerpt(unknown)}"] if unknown else []
    )
    normals = _read_table(path, "vn")
    if normals.shape == (len(vertices), 3) and _are_of_vertices(path):
        found |= dict(zip(_NORMALS, normals.T, strict=True))
    elif len(normals):
        notes.append("normals left out: they belong to corners of faces")
    check_end(path)
    return columns.from_columns(path, found, notes)


def read_obj_mesh(path: Path) -> tuple[Array, Triangles]:
    """Read the (m, 3) vertices and the (f, 3) triangles."""
    points = read_obj(path).points
    counts, vertices, _ = _read_faces(path)
    found = triangles.from_polygons(counts, vertices)
    return points, triangles.checked(found, len(points), path)


def _read_table(path: Path, word: str) -> Array:
    """Return the numbers behind ``word``."""
    with open_text(path) as stream:
        lines = Lines(stream, path)
        values = (rest for kind, rest in _Statements(lines, word) if kind == word)
        first = next(values, "")
        if not first:
            return np.zeros((0, 3))
        return read_table(itertools.chain([first], values), len(first.split()), lines)


def _unknown_words(path: Path) -> list[str]:
    """Return the first words of lines that are no statements of OBJ."""
    words = set()
    goes_on = False
    with open_text(path) as stream:
        for line in stream:
            if not goes_on and not line.isspace():
                words.add(line.split(None, 1)[0])
            goes_on = line.endswith("\\\n")
    return sorted(word for word in words if word not in _WORDS and not word.startswith("#"))


class _Statements:
    """Iterates over (word, rest of the line) of statements that begin with certain letters."""

    def __init__(self, lines: Lines, start: str = "") -> None:
        self._lines = lines
        self._start = start

    def __iter__(self) -> Iterator[tuple[str, str]]:
        lines = iter(self._lines)
        for line in lines:
            text = line.strip()
            if not text.startswith(self._start):
                continue
            while text.endswith("\\"):
                text = text[:-1] + next(lines, "").strip()
            if not text or text.startswith("#"):
                continue
            word, *rest = text.split(None, 1)
            yield word, rest[0] if rest else NO_ROW


def _are_of_vertices(path: Path) -> bool:
    """Return whether every corner of a face has the normal with the number of its vertex."""
    _, vertices, normals = _read_faces(path)
    return normals is None or bool(np.array_equal(vertices, normals))


def _read_faces(path: Path) -> tuple[Indices, Indices, Indices | None]:
    """Return the corners of each face, their vertices and, where they have some, their normals."""
    with open_text(path) as stream:
        lines = Lines(stream, path)
        alike = _Alike(_Statements(lines, "f"))
        try:
            table = read_table(alike, alike.width, lines) if alike.width else np.zeros((0, 0))
        except ValueError:
            return _walk_faces(path)
    corners = (table - 1).astype(np.int64).reshape(len(table), -1, max(alike.parts, 1))
    counts = np.full(len(table), corners.shape[1])
    normals = corners[:, :, -1].ravel() if alike.have_normals else None
    return counts, corners[:, :, 0].ravel(), normals


class _Alike:
    """Iterates over faces as rows of numbers, as long as all are written like the first.

    Attributes
    ----------
    parts : int
        Numbers of a corner.
    width : int
        Numbers of a face; 0 if there is none.
    have_normals : bool
        Whether the last number of a corner is its normal.
    """

    def __init__(self, statements: _Statements) -> None:
        self._faces = (rest for word, rest in statements if word == "f")
        self._first = next(self._faces, "")
        corner = self._first.partition(" ")[0]
        self._gaps = self._first.count("//")
        self.width = len(self._first.replace("/", " ").split())
        self.parts = len(corner.replace("/", " ").split())
        self.have_normals = corner.count("/") == 2

    def __iter__(self) -> Iterator[str]:
        for face in itertools.chain([self._first], self._faces):
            # A number below zero counts from the last vertex so far.
            is_alike = "-" not in face and face.count("//") == self._gaps
            yield face.replace("/", " ") if is_alike else NO_ROW


def _walk_faces(path: Path) -> tuple[Indices, Indices, Indices]:
    """Do the same face by face; a corner without a normal has that of its vertex."""
    seen = {"v": 0, "vn": 0}
    counts: list[int] = []
    corners: list[tuple[int, int]] = []
    with open_text(path) as stream:
        lines = Lines(stream, path)
        for word, rest in _Statements(lines):
            if word in seen:
                seen[word] += 1
            elif word == "f":
                try:
                    corners += [_corner(text, seen) for text in rest.split()]
                except ValueError:
                    raise lines.fault("a face") from None
                counts.append(len(rest.split()))
    pairs = np.array(corners, dtype=np.int64).reshape(-1, 2)
    return np.array(counts, dtype=np.int64), pairs[:, 0], pairs[:, 1]


def _corner(text: str, counts: dict[str, int]) -> tuple[int, int]:
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
