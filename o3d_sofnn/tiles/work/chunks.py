"""Inputs of a run, read part by part: LAS, LAZ, COPC and binary PLY are never in memory whole."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.files import child, las, las_layout, point_files
from o3d_sofnn.files.readers.ply import read_header
from o3d_sofnn.files.regular import open_regular, read_records
from o3d_sofnn.tiles.plan import Cloud
from o3d_sofnn.validation import check_magnitude, finite_rows

Array = NDArray[np.float64]


CHUNK = 1_000_000
"""Number of points that are read together."""


INPUTS = frozenset({".las", ".laz", ".ply", ".pcd", ".e57"})
"""Formats of the inputs; PCD, E57 and PLY as text are read file by file."""


def found(inputs: Sequence[str | os.PathLike[str]]) -> list[Path]:
    """Return the files of some names and wildcards, each once, in order.

    Raises
    ------
    ValueError
        A wildcard or folder has no point files, or a file is not of a known format.
    """
    names: dict[Path, None] = {}
    for each in inputs:
        text = os.fspath(each)
        matches = [text]
        if os.path.isdir(text):
            matches = sorted(
                os.path.join(text, name)
                for name in os.listdir(text)
                if Path(name).suffix.lower() in INPUTS and name[0] != "."
            )
        elif not os.path.lexists(text) and glob.has_magic(text):
            matches = sorted(glob.glob(text, recursive=True))
        if not matches:
            raise ValueError(f"{text}: expected point files, got none")
        names |= dict.fromkeys(map(Path, matches))
    for path in names:
        if not path.is_file():
            raise ValueError(f"{path}: expected a point file, got none")
        if path.suffix.lower() not in INPUTS:
            known = " ".join(sorted(INPUTS))
            raise ValueError(f"{path}: expected one of the endings {known}")
    if not names:
        raise ValueError("inputs: expected files, got none")
    return list(names)


class Files(Cloud):
    """Points of files that may overlap.

    Parameters
    ----------
    paths : sequence of Path
        The files, in the order of the run.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = list(paths)
        self.crs: str | None = None
        self.left_out = 0

    @property
    def identity(self) -> list[dict[str, Any]]:
        """What the files are: names, lengths and times of their last change."""
        return [
            {"file": str(path.resolve()), "bytes": stat.st_size, "changed": stat.st_mtime_ns}
            for path in self.paths
            for stat in [path.stat()]
        ]

    def chunks(self) -> Iterator[Array]:
        """Yield the finite points, some at a time; errors name the file."""
        self.left_out = 0
        for path in self.paths:
            try:
                for points in _parts(path):
                    finite = finite_rows(points)
                    self.left_out += int((~finite).sum())
                    points = np.ascontiguousarray(points[finite])
                    if len(points):
                        check_magnitude(points, str(path))
                        yield points
            except OSError as error:
                raise ValueError(f"{path}: not readable: {error.strerror or error}") from error

    def common_crs(self) -> str | None:
        """Return the coordinate system of the LAS files, if all have the same."""
        systems = set()
        for path in self.paths:
            if las.is_las(path):
                with open_regular(path) as stream:
                    systems.add(las.crs_of(las.read_header(stream, path)[1]))
        return systems.pop() if len(systems) == 1 else None


def _parts(path: Path) -> Iterator[Array]:
    if path.suffix.lower() in las.FORMATS or las.is_las(path):
        yield from _las_parts(path)
    elif path.suffix.lower() == ".ply" and (parts := _ply_parts(path)) is not None:
        yield from parts
    else:
        points = point_files.read_points(path).points
        for start in range(0, len(points), CHUNK):
            yield points[start : start + CHUNK]


def _las_parts(path: Path) -> Iterator[Array]:
    """Yield the coordinates of a LAS, LAZ or COPC file in double precision."""
    laspy = las.import_laspy()
    with open_regular(path) as stream:
        layout, header = las.read_header(stream, path)
        if header.are_points_compressed:
            frames: Iterator[bytes | bytearray] = child.run(las_layout.__name__, path)
        else:
            stream.seek(layout.offset)
            counts = [min(CHUNK, layout.count - i) for i in range(0, layout.count, CHUNK)]
            frames = (bytearray(read_records(stream, path, n, layout.record)) for n in counts)
        known, waiting, size = 0, [], 0
        for frame in frames:
            with las.laspy_errors(path):
                some = laspy.PackedPointRecord.from_buffer(bytearray(frame), header.point_format)
                axes = zip(("X", "Y", "Z"), header.scales, header.offsets, strict=True)
                points = np.stack([np.asarray(some[n]) * s + o for n, s, o in axes], axis=1)
            known += len(points)
            size += len(points)
            waiting.append(points)
            if size >= CHUNK:
                yield np.concatenate(waiting)
                waiting, size = [], 0
        if waiting:
            yield np.concatenate(waiting)
    if known != layout.count:
        raise ValueError(f"{path}: cut short: {known} of {layout.count} points")


def _ply_parts(path: Path) -> Iterator[Array] | None:
    """Return the coordinates of a binary PLY file in parts; None if it cannot be read so."""
    with open_regular(path) as stream:
        order, elements, _ = read_header(stream, path)
        first = elements[0] if elements else None
        start = stream.tell()
    names = [name for name, _, _ in first.properties] if first is not None else []
    if not order or first is None or first.name != "vertex" or first.has_lists:
        return None
    if not {"x", "y", "z"} <= set(names):
        return None
    kind = np.dtype([(name, order + kind) for name, kind, _ in first.properties])
    return _records(path, start, first.count, kind)


def _records(path: Path, start: int, total: int, kind: np.dtype[Any]) -> Iterator[Array]:
    with open_regular(path) as stream:
        stream.seek(start)
        for at in range(0, total, CHUNK):
            count = min(CHUNK, total - at)
            rows = np.frombuffer(read_records(stream, path, count, kind.itemsize), kind)
            yield np.stack([rows[n].astype(np.float64) for n in ("x", "y", "z")], axis=1)
