"""Files: clouds of any format are read in their own precision, and written whole or not at all."""

from __future__ import annotations

import logging
import os
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import adapters
from o3d_sofnn.files import las, reading, sidecar
from o3d_sofnn.files.columns import PointFile as PointFile
from o3d_sofnn.files.outputs import check_different as check_different
from o3d_sofnn.files.outputs import check_ending
from o3d_sofnn.files.outputs import check_output as check_output
from o3d_sofnn.files.outputs import open_atomic as open_atomic
from o3d_sofnn.files.writers import fitting, formats

_logger = logging.getLogger(__name__)


CLOUD_INPUTS = reading.FORMATS


CLOUD_OUTPUTS = frozenset(formats.CLOUD_WRITERS) | las.FORMATS


MESH_OUTPUTS = frozenset(formats.MESH_WRITERS)


def read_points(path: str | os.PathLike[str], ending: str | None = None) -> PointFile:
    """Read points of any known format, with all that the file has per point.

    Parameters
    ----------
    path : path-like
        The file; its extension determines the format. Of a mesh file, the vertices are read.
    ending : str, optional
        Read the file as if it had this extension (``.xyz``).

    Returns
    -------
    PointFile
        Arrays, the scanner's position, and ``notes`` on what differs from the file. The coordinate
        system may be in a file beside it, with the extension .prj.

    Raises
    ------
    OSError
        The file does not exist, is a folder, or may not be read.
    ValueError
        The extension is unknown, or contents that cannot be read to the end.
    ImportError
        A package for the format is missing; the message says what to type.
    """
    path = Path(path)
    if ending is None:
        ending = check_ending(path, CLOUD_INPUTS)
    elif ending not in CLOUD_INPUTS:
        known = " ".join(sorted(CLOUD_INPUTS))
        raise ValueError(f"ending: expected one of {known}, got {ending!r}")
    file = reading.read(path, ending)
    if file.crs is not None:
        return file
    crs, notes = sidecar.read(path)
    return replace(file, crs=crs, notes=(*file.notes, *notes))


def read_point_cloud(path: str | os.PathLike[str]) -> Any:
    """Read points of any known format, like :func:`read_points`, as a cloud of Open3D.

    Parameters
    ----------
    path : path-like
        The file; its extension determines the format. Of a mesh file, the vertices are read.

    Returns
    -------
    open3d.t.geometry.PointCloud
        Cloud in double precision if the file has it, with every attribute per point of the file.
        What is left out is logged.

    Raises
    ------
    OSError, ValueError, ImportError
        As in :func:`read_points`; also when Open3D is missing.
    """
    file = read_points(path)
    for note in file.notes:
        _logger.warning("%s: %s", path, note)
    return adapters.make_cloud(as_cloud(file))


def as_cloud(file: PointFile) -> adapters.CloudArrays:
    """Return only the points, normals and attributes of a file."""
    return adapters.CloudArrays(file.points, file.normals, file.attributes)


def write_point_cloud(
    path: str | os.PathLike[str],
    pcd: Any,
    *,
    template: str | os.PathLike[str] | None = None,
    extra: Mapping[str, NDArray[Any]] | None = None,
    crs: str | None = None,
) -> None:
    """Write points, normals and (as far as the format has room) attributes, whole or not at all.

    Parameters
    ----------
    path : path-like
        .ply and .npz keep everything; .las and .laz take normals as extra dimensions; .xyz and
        .xyzn are lines ``x y z nx ny nz``; .pcd is single precision.
    pcd : open3d.geometry.PointCloud or open3d.t.geometry.PointCloud
        The cloud.
    template : path-like, optional
        The file that ``pcd`` was read from: a LAS or LAZ output then keeps what only such a file
        holds (scale, offset, coordinate system). Ignored unless both are LAS or LAZ; the template
        may have any extension.
    extra : mapping of str to numpy.ndarray, shape (n,), optional
        Further numbers per point, by name: properties of PLY, arrays of NPZ, extra bytes of LAS and
        LAZ. A number is appended to names that the points already have; what a format cannot hold
        is logged.
    crs : str, optional
        Coordinate system, as in :class:`PointFile`: LAS and LAZ contain it (the ``template``'s
        is kept); for other formats it is written beside ``path``, with the extension .prj.

    Raises
    ------
    OSError
        The disk is full, the folder is missing or read-only; ``path`` is then as before.
    ValueError
        The extension is unknown, or a cloud that the format cannot hold.
    """
    path = Path(path)
    suffix = check_ending(path, CLOUD_OUTPUTS)
    arrays = adapters.read_cloud(pcd)
    source = _las_template(path, template)
    fitting.warn_of_rounding(path, arrays.points)
    keeps = formats.CLOUD_KEEPS[suffix]
    if suffix in las.FORMATS:
        if source is None:
            arrays = fitting.fitted(path, arrays, keeps)
        named = fitting.named(path, extra or {}, arrays.attributes)
        with open_atomic(path) as stream:
            las.write_las(stream, arrays, suffix == ".laz", source, named, crs)
        return
    arrays = fitting.joined(arrays, fitting.named(path, extra or {}, arrays.attributes))
    arrays = fitting.fitted(path, arrays, keeps)
    with open_atomic(path) as stream:
        formats.CLOUD_WRITERS[suffix](stream, arrays)
    if crs is not None:
        sidecar.write(path, crs)


def write_triangle_mesh(
    path: str | os.PathLike[str],
    mesh: Any,
    *,
    extra: Mapping[str, NDArray[Any]] | None = None,
    crs: str | None = None,
) -> None:
    """Write a mesh with vertex normals and colours, whole or not at all.

    Parameters
    ----------
    path : path-like
        .ply, .obj and .off keep every digit; .glb has single precision relative to a local origin;
        .stl has single precision and no colours.
    mesh : open3d.geometry.TriangleMesh or open3d.t.geometry.TriangleMesh
        The mesh.
    extra : mapping of str to numpy.ndarray, shape (m,), optional
        Further numbers per vertex, as in :func:`write_point_cloud`.
    crs : str, optional
        Coordinate system, written beside ``path`` with the extension .prj.

    Raises
    ------
    OSError
        The disk is full, the folder is missing or read-only; ``path`` is then as before.
    ValueError
        The extension is unknown.
    """
    path = Path(path)
    suffix = check_ending(path, MESH_OUTPUTS)
    vertices, triangles = adapters.read_mesh(mesh)
    fitting.warn_of_rounding(path, vertices.points)
    vertices = fitting.joined(vertices, fitting.named(path, extra or {}, vertices.attributes))
    vertices = fitting.fitted(path, vertices, formats.MESH_KEEPS[suffix])
    with open_atomic(path) as stream:
        formats.MESH_WRITERS[suffix](stream, vertices, triangles)
    if crs is not None:
        sidecar.write(path, crs)


def check_contents(
    path: str | os.PathLike[str],
    file: PointFile,
    template: str | os.PathLike[str] | None = None,
    extra: Collection[str] = (),
) -> None:
    """Raise what writing the points of ``file`` to ``path`` would raise, before the work is done.

    Parameters
    ----------
    path : path-like
        The file to be written.
    file : PointFile
        The contents to be written there, with normals.
    template : path-like, optional
        As in :func:`write_point_cloud`.
    extra : collection of str, default ()
        Names of further numbers per point.

    Raises
    ------
    ValueError
        The format cannot hold the points or the other contents of ``template``.
    ImportError
        laspy is needed and missing.
    """
    path = Path(path)
    if path.suffix.lower() in las.FORMATS:
        source = _las_template(path, template)
        taken = {} if source is None else file.attributes
        one = {name: np.zeros(1) for name in extra}
        las.check_las(file.points, path.suffix.lower() == ".laz", source, fitting.free(one, taken))


def _las_template(path: Path, template: str | os.PathLike[str] | None) -> Path | None:
    """Return ``template`` if ``path`` can keep what only LAS holds."""
    if template is None or path.suffix.lower() not in las.FORMATS:
        return None
    template = Path(template)
    is_las = template.suffix.lower() in las.FORMATS or las.is_las(template)
    return template if is_las else None
