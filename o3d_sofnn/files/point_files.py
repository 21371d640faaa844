"""Files: read a cloud of any format in its own precision, write whole or not at all."""

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
        The file; its ending says the format. Of a mesh file the vertices are taken.
    ending : str, optional
        Read as if the file had this ending (``.xyz``).

    Returns
    -------
    PointFile
        Arrays, where the scanner stood, and ``notes`` on what is not as in the file. A coordinate
        system may be beside the file, with the ending .prj.

    Raises
    ------
    OSError
        No such file, a folder, no permission.
    ValueError
        An ending that is not known, or contents that cannot be read to the end.
    ImportError
        What the format needs is missing; the message says what to type.
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
    """Read points of any known format as :func:`read_points`, as a cloud of Open3D.

    Parameters
    ----------
    path : path-like
        The file; its ending says the format. Of a mesh file the vertices are taken.

    Returns
    -------
    open3d.t.geometry.PointCloud
        In double precision where the file has it, with every attribute per point that the file
        has. What it lacks of the file is logged.

    Raises
    ------
    OSError, ValueError, ImportError
        As of :func:`read_points`; also when Open3D is missing.
    """
    file = read_points(path)
    for note in file.notes:
        _logger.warning("%s: %s", path, note)
    return adapters.make_cloud(as_cloud(file))


def as_cloud(file: PointFile) -> adapters.CloudArrays:
    """Return the points, normals and attributes of a file alone."""
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
        may have any ending.
    extra : mapping of str to numpy.ndarray, shape (n,), optional
        Further numbers per point, under their names: properties of PLY, arrays of NPZ, extra bytes
        of LAS and LAZ. A name that the points have already gets a number; what a format cannot
        hold is logged.
    crs : str, optional
        Coordinate system, as of :class:`PointFile`: LAS and LAZ hold it (that of ``template`` is
        kept), for other formats it is written beside ``path``, with the ending .prj.

    Raises
    ------
    OSError
        The disk is full, the folder is missing or read-only; ``path`` is then as before.
    ValueError
        An ending that is not known, or a cloud that the format cannot hold.
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
        .ply, .obj and .off keep every digit; .glb is single precision about a local origin; .stl is
        single precision without colours.
    mesh : open3d.geometry.TriangleMesh or open3d.t.geometry.TriangleMesh
        The mesh.
    extra : mapping of str to numpy.ndarray, shape (m,), optional
        Further numbers per vertex, as of :func:`write_point_cloud`.
    crs : str, optional
        Coordinate system, written beside ``path`` with the ending .prj.

    Raises
    ------
    OSError
        The disk is full, the folder is missing or read-only; ``path`` is then as before.
    ValueError
        An ending that is not known.
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
        What is going to be written there, with normals.
    template : path-like, optional
        As of :func:`write_point_cloud`.
    extra : collection of str, default ()
        Names of further numbers per point.

    Raises
    ------
    ValueError
        The format cannot hold the points, or not what else is in ``template``.
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
    """Return ``template`` where ``path`` can keep what only LAS holds."""
    if template is None or path.suffix.lower() not in las.FORMATS:
        return None
    template = Path(template)
    is_las = template.suffix.lower() in las.FORMATS or las.is_las(template)
    return template if is_las else None
