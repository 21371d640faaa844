"""PTX: scans as grids, each with the place and the pose of its scanner."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from o3d_sofnn.files import columns
from o3d_sofnn.files.columns import Array, PointFile
from o3d_sofnn.files.readers.lines import Lines, check_end, open_text, read_table

# Columns behind the header: coordinates, intensity, colours.
_NAMES = ("x", "y", "z", "intensity", "red", "green", "blue")


# Lines with the scanner's place, its three axes, and the transformation of its points.
_POSE = (3, 3, 3, 3, 4, 4, 4, 4)


def read_ptx(path: Path) -> PointFile:
    """Read the points of all scans in common coordinates, with the place of each scanner.

    Places of the grid where nothing came back, 0 0 0, are no points.

    Raises
    ------
    OSError
        The file cannot be opened.
    ValueError
        A line is no row of numbers, or there are fewer than its header says.
    """
    parts: list[Array] = []
    places: list[Array] = []
    notes: list[str] = []
    shape = (0, 0)
    with open_text(path) as stream:
        lines = Lines(stream, path)
        rows = (line for line in lines if not line.isspace())
        for header in rows:
            width, height = _count(header, lines), _count(next(rows, ""), lines)
            shape = (width, height)
            pose = [_numbers(rows, count, lines) for count in _POSE]
            table = _read_scan(rows, width * height, lines)
            hit = np.asarray(table[:, :3].any(axis=1))
            if not hit.all():
                lost = len(hit) - int(np.count_nonzero(hit))
                notes.append(f"scan {len(parts) + 1}: {lost} of {len(hit)} places hold no point")
            transform = np.array(pose[4:])
            table[:, :3] = table[:, :3] @ transform[:3, :3] + transform[3, :3]
            parts.append(table[hit])
            places.append(transform[3, :3] if transform[3, :3].any() else np.array(pose[0]))
    if not parts:
        raise ValueError(f"{path}: not readable as PTX: no scan")
    check_end(path)
    least = min(part.shape[1] for part in parts)
    if any(part.shape[1] > least for part in parts):
        notes.append("colours left out: not all scans have them")
    joined = np.concatenate([part[:, :least] for part in parts])
    seen_from = (
        places[0] if len(places) == 1 else np.repeat(places, [len(p) for p in parts], axis=0)
    )
    return columns.from_columns(
        path,
        dict(zip(_NAMES, joined.T, strict=False)),
        notes,
        viewpoint=seen_from if np.isfinite(seen_from).all() else None,
        shape=shape if len(parts) == 1 and len(joined) == math.prod(shape) else None,
    )


def _count(line: str, lines: Lines) -> int:
    text = line.strip()
    if not (text.isdecimal() and text.isascii() and len(text) < 10):
        raise lines.fault("the size of a scan's grid")
    return int(text)


def _numbers(rows: Iterator[str], count: int, lines: Lines) -> list[float]:
    table = read_table(itertools.islice(rows, 1), count, lines)
    if len(table) == 0:
        raise lines.fault(f"{count} numbers of the scanner's pose behind it")
    return [float(value) for value in table[0]]


def _read_scan(rows: Iterator[str], count: int, lines: Lines) -> Array:
    """Return ``count`` rows of a scan: x y z intensity, or colours behind them."""
    first = next(rows, "") if count else ""
    width = len(first.split()) if count else 4
    if width not in (4, 7):
        raise lines.fault("x y z intensity, with or without colours")
    left = itertools.islice(rows, count - 1) if count else iter(())
    table = read_table(itertools.chain([first] if count else [], left), width, lines)
    if len(table) < count:
        raise lines.fault(f"{count} points of a scan, of which {len(table)} are there, behind it")
    return table
