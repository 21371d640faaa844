"""Choice of a reader by a file's extension; messages name the file."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from o3d_sofnn.files import las, natives, triangles
from o3d_sofnn.files.columns import Array, PointFile
from o3d_sofnn.files.readers import arrays, gltf, meshes, obj, pcd, ply, ptx, text
from o3d_sofnn.files.triangles import Triangles

_Result = TypeVar("_Result")


_READERS: dict[str, Callable[[Path], PointFile]] = {
    ".ply": ply.read_ply,
    ".pcd": pcd.read_pcd,
    ".ptx": ptx.read_ptx,
    ".e57": natives.read_e57,
    ".npy": arrays.read_npy,
    ".npz": arrays.read_npz,
    ".obj": obj.read_obj,
    ".off": meshes.read_off,
    ".stl": meshes.read_stl,
    ".gltf": gltf.read_gltf,
    ".glb": gltf.read_gltf,
    ".fbx": natives.read_fbx,
    **{ending: functools.partial(text.read_text, ending=ending) for ending in text.FORMATS},
    **dict.fromkeys(las.FORMATS, las.read_las),
}


_MESH_READERS: dict[str, Callable[[Path], tuple[Array, Triangles]]] = {
    ".ply": ply.read_ply_mesh,
    ".obj": obj.read_obj_mesh,
    ".off": meshes.read_off_mesh,
    ".stl": meshes.read_stl_mesh,
    ".gltf": gltf.read_gltf_mesh,
    ".glb": gltf.read_gltf_mesh,
    ".fbx": natives.read_fbx_mesh,
}


FORMATS = frozenset(_READERS)


def read(path: Path, ending: str) -> PointFile:
    """Return the contents of a file in the format of an extension in ``FORMATS``.

    Raises
    ------
    OSError, ValueError, ImportError
        As raised by the reader; the message names the file.
    """
    return _guarded(_READERS[ending], path)


def read_triangles(path: Path) -> tuple[Array, Triangles]:
    """Return the (m, 3) vertices and (f, 3) triangles of a mesh file; a cloud has no triangles.

    Vertices that are repeated for every triangle are merged.

    Raises
    ------
    OSError, ValueError, ImportError
        As raised by the reader; the message names the file.
    """
    points, corners = _guarded(_MESH_READERS[path.suffix.lower()], path)
    kept, index = triangles.join_vertices(points)
    return points[kept], index[corners]


def _guarded(reader: Callable[[Path], _Result], path: Path) -> _Result:
    """Read without warnings about non-finite numbers; every message names the file."""
    try:
        with np.errstate(all="ignore"):
            return reader(path)
    except ValueError as error:
        if str(path) in str(error):
            raise
        raise ValueError(f"{path}: not readable: {error}") from error
