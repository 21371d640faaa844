"""Delimited text: one point a line, whatever the delimiter, the decimal sign and the first lines.

From the first line with three numbers on, every line is a row of as many, or an error that has its
number.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from o3d_sofnn.files import columns
from o3d_sofnn.files.columns import Array, PointFile
from o3d_sofnn.files.readers import layout
from o3d_sofnn.files.readers.layout import Layout
from o3d_sofnn.files.readers.lines import NO_ROW, Lines, check_end, open_text, read_table

FORMATS = frozenset({".xyz", ".xyzn", ".xyzrgb", ".pts", ".txt", ".csv", ".asc"})


# How far the length of a vector written with few digits may be from that of a normal.
_UNIT_SLACK = 0.02


def read_text(path: Path, ending: str) -> PointFile:
    """Read lines ``x y z ...``; the ending says what columns without names may be.

    Delimited by comma, semicolon, tab, bar or blanks; decimal point or comma; UTF-8 or UTF-16;
    comments; names of columns; a line with the number of points (in PTS before every scan).

    Raises
    ------
    OSError
        The file cannot be opened.
    ValueError
        A line is no row of numbers (the message has its number), there are more or fewer rows than
        announced, or the contents are no text.
    """
    with open_text(path) as stream:
        found = layout.find(Lines(stream, path))
    if found is None:
        return PointFile(np.zeros((0, 3)))
    with open_text(path) as stream:
        for _ in itertools.islice(stream, found.skip):
            pass
        lines = Lines(stream, path, found.skip)
        rows = _Rows(found, lines, has_scans=ending == ".pts")
        # Fields are delimited anew where words are left out.
        delimiter = found.split.delimiter if len(found.used) == found.width else None
        table = read_table(rows, len(found.used), lines, delimiter)
    rows.check(path, len(table))
    check_end(path, "," if found.split.decimal_comma else ".")
    names = columns.unique_names(found.names or _guess_names(table, ending))
    notes = list(found.notes)
    if not columns.has_coordinates(names):
        notes.append(f"no columns x y z: taken from {' '.join(names[:3])}")
        names[:3] = "x", "y", "z"
    garbled = [name for name in names if "\ufffd" in name]
    if garbled:
        notes.append(f"names of columns are no UTF-8, some letters are lost: {' '.join(garbled)}")
    unnamed = [name for name in names if name.startswith("column_")]
    if unnamed and found.names is None:
        notes.append(f"columns without names kept as {' '.join(unnamed)}")
    return columns.from_columns(path, dict(zip(names, table.T, strict=True)), notes)


class _Rows:
    """Iterates over the rows of a text, cleaned for NumPy, and heeds the counts in between."""

    def __init__(self, found: Layout, lines: Lines, has_scans: bool) -> None:
        self._found = found
        self._lines = lines
        self._has_scans = has_scans
        self._count = 0
        # Numbers of rows announced, and how many there were before.
        self._scans = [] if found.announced is None else [(found.announced, 0)]

    def __iter__(self) -> Iterator[str]:
        for line in self._lines:
            text = layout.without_comment(line)
            if not text or (self._has_scans and self._is_mark(text)):
                continue
            self._count += 1
            yield self._clean(text)

    def check(self, path: Path, count: int) -> None:
        """Raise ``ValueError`` unless there are as many rows as announced."""
        starts = [start for _, start in self._scans] + [count]
        for (announced, start), end in zip(self._scans, starts[1:], strict=True):
            if end - start != announced:
                raise ValueError(
                    f"{path}: expected {announced} points as it says, got {end - start}"
                )

    def _is_mark(self, text: str) -> bool:
        """Take note of a line that starts or ends a scan."""
        if text.isdecimal() and text.isascii():
            self._scans.append((int(text[:18]), self._count))
            return True
        return text.upper() in ("BEGIN", "END")

    def _clean(self, text: str) -> str:
        """Return a row as NumPy reads it: decimal points, NaN in empty fields, no words."""
        found = self._found
        if "#" in text:
            text = text.partition("#")[0].rstrip()
        delimiter = found.split.delimiter
        simple = len(found.used) == found.width and '"' not in text
        if simple and (delimiter is None or not _has_gap(text, delimiter)):
            return found.split.with_points(text)
        fields = [field or "nan" for field in found.split.fields(text)]
        if len(fields) != found.width:
            return NO_ROW
        if len(found.used) < found.width:
            return " ".join(fields[i] for i in found.used)
        return (delimiter or " ").join(fields)


def _has_gap(text: str, delimiter: str) -> bool:
    """Return whether a field is empty, also the last one."""
    return delimiter + delimiter in text or text.startswith(delimiter) or text.endswith(delimiter)


def _guess_names(table: Array, suffix: str) -> list[str]:
    """Return names for columns that have none: as the format says, else as the numbers look.

    Three columns of unit (or zero) vectors are normals, three of whole numbers to 255 are colours.
    """
    width = table.shape[1]
    names = ["x", "y", "z", *(f"column_{i + 1}" for i in range(3, width))]
    start = 3
    if suffix == ".pts" and width in (4, 7, 10):
        names[3] = "intensity"
        start = 4
    elif width % 3:
        start = width if suffix not in (".xyzn", ".xyzrgb") else start
    for i in range(start, width - 2, 3):
        three = table[:, i : i + 3]
        if "nx" not in names and ((suffix == ".xyzn" and i == 3) or _are_normals(three)):
            names[i : i + 3] = "nx", "ny", "nz"
        elif "red" not in names and ((suffix == ".xyzrgb" and i == 3) or _are_levels(three)):
            names[i : i + 3] = "red", "green", "blue"
    return names


def _are_normals(three: Array) -> bool:
    length = np.linalg.norm(three, axis=1)
    return bool(np.all((np.abs(length - 1.0) < _UNIT_SLACK) | (length == 0.0)))


def _are_levels(three: Array) -> bool:
    return bool(np.all((three == np.rint(three)) & (three >= 0) & (three <= 255)))
