"""Point files through Open3D, without its habit of passing off broken files as data."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import adapters

_logger = logging.getLogger(__name__)


# Open3D's tensor readers keep the file's number types and its further attributes; for text files
# they round to single precision, where the legacy readers keep double.
_TENSOR_FORMATS = frozenset({".ply", ".pcd", ".npz"})


_LEGACY_FORMATS = frozenset({".xyz", ".xyzn", ".xyzrgb", ".pts"})


_LINE_FORMATS = frozenset({".xyz", ".xyzn", ".xyzrgb"})


_MESH_FORMATS = frozenset({".obj", ".off", ".stl", ".gltf", ".glb", ".fbx"})


FORMATS = _TENSOR_FORMATS | _LEGACY_FORMATS | _MESH_FORMATS


def read_with_open3d(path: Path) -> Any:
    """Return the points of a file as a tensor cloud, in the precision of the file.

    Parameters
    ----------
    path : pathlib.Path
        A file whose ending is in ``FORMATS``; of a mesh, the vertices are taken.

    Returns
    -------
    open3d.t.geometry.PointCloud
        With all attributes that the file has per point, as far as Open3D reads them.

    Raises
    ------
    ValueError
        Open3D cannot read the file, or not to its end.
    """
    cloud = _without_complaint(path, lambda: _read(path))
    if path.suffix.lower() in _LINE_FORMATS:
        _miss_lines(path, len(cloud.point["positions"]))
    return cloud


def read_triangles(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the (m, 3) vertices and (f, 3) triangles of a mesh file; no triangles of a cloud.

    Vertices that are repeated for every triangle, as in an STL file, are joined.

    Raises
    ------
    ValueError
        Open3D cannot read the file, or not to its end.
    """
    o3d = adapters.import_open3d()
    read = o3d.io.read_triangle_mesh
    mesh = _without_complaint(path, lambda: read(str(path)).remove_duplicated_vertices())
    vertices, triangles = adapters.read_mesh(mesh)
    return vertices.points, triangles


def _read(path: Path) -> Any:
    o3d = adapters.import_open3d()
    suffix = path.suffix.lower()
    if suffix in _TENSOR_FORMATS:
        return o3d.t.io.read_point_cloud(str(path), format=suffix[1:])
    if suffix in _LEGACY_FORMATS:
        legacy = o3d.io.read_point_cloud(str(path), format=suffix[1:])
        return adapters.make_cloud(adapters.read_cloud(legacy))
    vertices, _ = adapters.read_mesh(o3d.io.read_triangle_mesh(str(path)))
    return adapters.make_cloud(vertices)


def _without_complaint(path: Path, read: Callable[[], Any]) -> Any:
    """Return ``read()``, and turn what Open3D says about failing into one ValueError.

    Its readers report trouble on the console only and return what they have: for a file cut short,
    as many points as the header promised. The PLY library below it writes to the C stream.
    """
    utility = adapters.import_open3d().utility
    console = io.StringIO()
    with (
        _standard_error_muted(),
        contextlib.redirect_stdout(console),
        utility.VerbosityContextManager(utility.VerbosityLevel.Warning),
    ):
        try:
            result = read()
        except RuntimeError as error:
            raise ValueError(f"{path}: not readable: {_one_line(str(error))}") from error
    complaint = _one_line(console.getvalue())
    if re.search("failed|unable to", complaint, re.IGNORECASE):
        raise ValueError(f"{path}: not readable: {complaint}")
    return result


def _miss_lines(path: Path, count: int) -> None:
    """Say so when lines of a file with one point a line were skipped, as Open3D does silently.

    Raises
    ------
    ValueError
        There are lines, but no points.
    """
    with path.open("rb") as stream:
        lines = (line for line in stream if line.strip() and not line.startswith(b"#"))
        first = next(lines, b"")[:60].decode(errors="replace").strip()
        total = bool(first) + sum(1 for _ in lines)
    if total and not count:
        raise ValueError(f"{path}: expected lines 'x y z' with blanks in between, got {first!r}")
    if total > count:
        lost = total - count
        _logger.warning("%s: %d of %d lines are no points and were left out", path, lost, total)


def _one_line(text: str) -> str:
    """Return ``text`` without line breaks, terminal colours and Open3D's marks."""
    return " ".join(re.sub(r"\x1b\[[0-9;]*m|\[Open3D \w+\]", "", text).split())


@contextlib.contextmanager
def _standard_error_muted() -> Iterator[None]:
    """Send what native code writes to the standard error stream nowhere."""
    with tempfile.TemporaryFile() as sink:
        saved = os.dup(2)
        try:
            os.dup2(sink.fileno(), 2)
            yield
        finally:
            os.dup2(saved, 2)
            os.close(saved)
