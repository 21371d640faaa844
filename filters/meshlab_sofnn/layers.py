"""Between MeshLab's layers and arrays."""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from meshlab_sofnn.engine import Cloud, Surface, given_colors
from meshlab_sofnn.ply import write_ply

SURFACE_LABEL = "SOFNN mesh"


def point_layer(ms: pymeshlab.MeshSet, filter_name: str) -> Any:
    """Return the current layer, which must be a point cloud.

    Raises
    ------
    pymeshlab.PyMeshLabException
        No layer, an empty one, one with faces, or one with a singular matrix.
    """
    if ms.mesh_number() == 0:
        raise pymeshlab.PyMeshLabException(
            f"{filter_name} requires at least one mesh loaded in the MeshSet."
        )
    mesh = ms.current_mesh()
    if mesh.vertex_number() == 0:
        raise pymeshlab.PyMeshLabException(
            f"{filter_name}: layer '{mesh.label()}' is empty, expected a point cloud."
        )
    if mesh.face_number() > 0:
        raise pymeshlab.PyMeshLabException(
            f"{filter_name}: layer '{mesh.label()}' has {mesh.face_number()} faces, expected a "
            "point cloud. Delete the faces (meshing_remove_all_faces) or sample points on them "
            "(generate_sampling_poisson_disk) first."
        )
    if np.linalg.det(mesh.transform_matrix()[:3, :3]) == 0:
        raise pymeshlab.PyMeshLabException(
            f"{filter_name}: the matrix of layer '{mesh.label()}' flattens it."
        )
    return mesh


def box_diagonal(mesh: Any) -> float:
    """Return the diagonal of a layer's bounding box after its matrix has moved the corners."""
    box = mesh.bounding_box()
    corners = np.array(list(itertools.product(*zip(box.min(), box.max(), strict=True))))
    matrix = mesh.transform_matrix()
    return float(np.linalg.norm(np.ptp(corners @ matrix[:3, :3].T, axis=0)))


def read_cloud(mesh: Any, with_normals: bool) -> Cloud:
    """Return a layer's points, normals and colours, its matrix applied."""
    colors = np.rint(mesh.vertex_color_matrix() * 255).astype(np.uint8)
    normals = None
    if with_normals:
        normals = mesh.vertex_normal_matrix() @ np.linalg.inv(mesh.transform_matrix()[:3, :3])
    return Cloud(
        points=np.ascontiguousarray(mesh.transformed_vertex_matrix()),
        normals=normals,
        colors=given_colors(colors),
    )


def add_surface(ms: pymeshlab.MeshSet, surface: Surface) -> None:
    """Add a surface as a new layer and make it the current one.

    It goes through a temporary PLY file: PyMeshLab takes four times as long for arrays, and
    computes the normals of a mesh with faces anew, while those in a file are kept.

    Raises
    ------
    pymeshlab.PyMeshLabException
        The file cannot be written, or not be read. The MeshSet is then unchanged.
    """
    label = _free_label(ms)
    with _temporary_folder() as folder:
        file = folder / "surface.ply"
        write_ply(file, surface)
        ms.load_new_mesh(str(file))
    ms.current_mesh().set_label(label)


def _free_label(ms: pymeshlab.MeshSet) -> str:
    """Return the label of a new surface, with a number if there is one already."""
    taken = {mesh.label() for mesh in ms}
    labels = itertools.chain(
        [SURFACE_LABEL], (f"{SURFACE_LABEL}({number})" for number in itertools.count(1))
    )
    return next(label for label in labels if label not in taken)


def write_normals(ms: pymeshlab.MeshSet, normals: NDArray[np.float64]) -> None:
    """Give the vertices of the current layer the normals ``normals`` (world coordinates)."""
    linear = ms.current_mesh().transform_matrix()[:3, :3]
    if not np.array_equal(linear, np.eye(3)):
        normals = normals @ linear
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        # Vertices that are not finite have the normal 0 and keep it.
        normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    _set_normals(ms, normals)


def _set_normals(ms: pymeshlab.MeshSet, normals: NDArray[np.float64]) -> None:
    """Write vertex normals into the current layer, for which PyMeshLab has no setter.

    Custom attributes can be written, and MeshLab's normal function can read them. PyMeshLab
    cannot delete them: they stay on the layer. (One attribute of three numbers would do, but
    MeshLab's function reads a stray address instead of the first of them.)
    """
    mesh = ms.current_mesh()
    names = _free_names(mesh)
    with _script_kept(ms):
        for name, values in zip(names, normals.T, strict=True):
            mesh.add_vertex_custom_scalar_attribute(np.ascontiguousarray(values), name)
        ms.apply_filter(
            "compute_normal_by_function_per_vertex", **dict(zip("xyz", names, strict=True))
        )


def _free_names(mesh: Any) -> list[str]:
    """Return three names of custom attributes that the layer does not have yet."""
    run = 0
    while True:
        run += 1
        names = [f"sofnn_normal_{run}_{axis}" for axis in "xyz"]
        try:
            mesh.vertex_custom_scalar_attribute_array(names[0])
        except pymeshlab.PyMeshLabException:
            return names


@contextmanager
def _script_kept(ms: pymeshlab.MeshSet) -> Iterator[None]:
    """Take out of the user's filter script what the filters called within the block add to it.

    MeshLab can only save and load a whole script, with six digits of a number.
    """
    with _temporary_folder() as folder:
        script = folder / "script.mlx"
        ms.save_filter_script(str(script))
        try:
            yield
        finally:
            ms.clear_filter_script()
            if "<filter" in script.read_text():
                ms.load_filter_script(str(script))


@contextmanager
def _temporary_folder() -> Iterator[Path]:
    """Yield a folder for what PyMeshLab takes as a file only."""
    try:
        with tempfile.TemporaryDirectory() as folder:
            yield Path(folder)
    except OSError as error:
        raise pymeshlab.PyMeshLabException(
            f"A temporary file could not be written: {error}"
        ) from error
