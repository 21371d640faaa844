"""Kinds of clouds that users pass in and get back: arrays, Open3D, trimesh, PyVista.

No library is imported to recognise its objects: whoever has such an object has imported it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import adapters, validation
from o3d_sofnn.adapters import CloudArrays

Array = NDArray[np.float64]
Triangles = NDArray[np.integer[Any]]


class Family(Protocol):
    """How to read clouds of one kind, and how to return results."""

    def read(self, pcd: Any) -> CloudArrays:
        """Return copies of the arrays of a cloud; a ``ValueError`` says what does not fit."""

    def with_normals(self, pcd: Any, normals: Array) -> Any:
        """Return what ``estimate_normals`` returns for (n, 3) normals."""

    def mesh(self, pcd: Any, vertices: CloudArrays, triangles: Triangles) -> Any:
        """Return what ``reconstruct_surface`` returns for a mesh.

        Parameters
        ----------
        pcd : object
            The cloud that the mesh was reconstructed from.
        vertices : CloudArrays
            Coordinates, normals and attributes of the m vertices.
        triangles : numpy.ndarray, shape (f, 3)
            Vertex indices.
        """


def family_of(pcd: Any) -> Family:
    """Return the family of a cloud; objects of unknown libraries are treated as arrays."""
    if isinstance(pcd, CloudArrays):
        return Held()
    names = {f"{base.__module__.partition('.')[0]}.{base.__name__}" for base in type(pcd).__mro__}
    if any(name.startswith("open3d.") for name in names):
        return Open3D()
    if "trimesh.PointCloud" in names:
        return Trimesh()
    if names & {"pyvista.PolyData", "pyvista.PointSet"}:
        return PyVista()
    return Arrays()


class Arrays:
    """An (n, 3) array, or something convertible; normals and meshes are returned as arrays."""

    def read(self, pcd: Any) -> CloudArrays:
        """See :class:`Family`."""
        try:
            array = np.array(pcd)
        except ValueError as error:  # rows of different lengths
            raise ValueError(f"points: expected shape (n, 3): {error}") from error
        if array.ndim == 0:
            raise ValueError(
                "pcd: expected an (n, 3) array, a PointCloud of Open3D or trimesh, or a PolyData "
                f"of PyVista, got {type(pcd).__name__}"
            )
        return CloudArrays(validation.check_array(array, "points"))

    def with_normals(self, pcd: Any, normals: Array) -> Array:
        """Return the normals."""
        return normals

    def mesh(
        self, pcd: Any, vertices: CloudArrays, triangles: Triangles
    ) -> tuple[Array, Triangles]:
        """Return vertices and triangles."""
        return vertices.points, triangles


class Open3D:
    """Legacy and tensor clouds of Open3D; normals are written in place."""

    def read(self, pcd: Any) -> CloudArrays:
        """See :class:`Family`."""
        return adapters.read_cloud(pcd)

    def with_normals(self, pcd: Any, normals: Array) -> Any:
        """Write the normals into the cloud and return it."""
        adapters.write_normals(pcd, normals)
        return pcd

    def mesh(self, pcd: Any, vertices: CloudArrays, triangles: Triangles) -> Any:
        """Return a TriangleMesh, legacy or tensor like the cloud."""
        return adapters.make_mesh(pcd, vertices, triangles)


class Trimesh:
    """``trimesh.PointCloud``: normals go into its metadata, meshes are ``trimesh.Trimesh``."""

    def read(self, pcd: Any) -> CloudArrays:
        """See :class:`Family`."""
        points, normals = np.array(pcd.vertices), pcd.metadata.get("normals")
        has_colors = len(pcd.colors) == len(points)
        attributes = {"colors": np.array(pcd.colors) / 255.0} if has_colors else {}
        copy = None if normals is None else np.array(normals)
        return adapters.checked(CloudArrays(points, copy, attributes), "pcd")

    def with_normals(self, pcd: Any, normals: Array) -> Any:
        """Write ``pcd.metadata["normals"]`` and return the cloud."""
        pcd.metadata["normals"] = normals
        return pcd

    def mesh(self, pcd: Any, vertices: CloudArrays, triangles: Triangles) -> Any:
        """Return a Trimesh with vertex normals and, if the cloud has them, colours."""
        import trimesh

        colors = vertices.attributes.get("colors")
        return trimesh.Trimesh(
            vertices.points,
            triangles,
            vertex_normals=vertices.normals,
            vertex_colors=None if colors is None else np.rint(255.0 * colors).astype(np.uint8),
            process=False,
        )


class PyVista:
    """``pyvista.PolyData`` and ``PointSet``; normals are named as in VTK."""

    def read(self, pcd: Any) -> CloudArrays:
        """See :class:`Family`."""
        stored = {name: np.array(pcd.point_data[name]) for name in pcd.point_data}
        normals = stored.pop("Normals", None)
        attributes = {name: values.reshape(len(values), -1) for name, values in stored.items()}
        parts = CloudArrays(np.array(pcd.points), normals, attributes)
        return adapters.checked(parts, "pcd")

    def with_normals(self, pcd: Any, normals: Array) -> Any:
        """Write ``pcd.point_data["Normals"]`` and return the cloud."""
        pcd.point_data["Normals"] = normals
        return pcd

    def mesh(self, pcd: Any, vertices: CloudArrays, triangles: Triangles) -> Any:
        """Return a PolyData with normals and the attributes of the points."""
        import pyvista

        faces = np.column_stack([np.full(len(triangles), 3), triangles])
        mesh = pyvista.PolyData(vertices.points, faces.ravel())
        if vertices.normals is not None:
            mesh.point_data["Normals"] = vertices.normals
        for name, values in vertices.attributes.items():
            mesh.point_data[name] = values[:, 0] if values.shape[1] == 1 else values
        return mesh


class Held:
    """The contents of a file, for programs that need no library for point clouds."""

    def read(self, pcd: CloudArrays) -> CloudArrays:
        """See :class:`Family`."""
        return pcd

    def with_normals(self, pcd: CloudArrays, normals: Array) -> CloudArrays:
        """Return the same with normals."""
        return replace(pcd, normals=normals)

    def mesh(
        self, pcd: CloudArrays, vertices: CloudArrays, triangles: Triangles
    ) -> tuple[CloudArrays, Triangles]:
        """Return the vertices with all their attributes, and the triangles."""
        return vertices, triangles
