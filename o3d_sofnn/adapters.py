"""The only module that uses Open3D: converts legacy and tensor clouds to float64 arrays and back.

Open3D is imported inside the functions: that takes seconds, and any of its packages (``open3d``,
``open3d-cpu`` ...) will do, so this package does not depend on one of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import validation


@dataclass(frozen=True)
class CloudArrays:
    """A point cloud as arrays on the host, in the user's order.

    Attributes
    ----------
    points : numpy.ndarray, shape (n, 3), float64
        Coordinates, including NaN and infinity.
    normals : numpy.ndarray, shape (n, 3), float64, or None
        Normals, if the cloud has them.
    attributes : dict of str to numpy.ndarray, shape (n, k)
        Everything else that is stored per point ("colors" among them), in its own number type.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64] | None = None
    attributes: dict[str, NDArray[Any]] = field(default_factory=dict)


def import_open3d() -> Any:
    """Return the module ``open3d``.

    Raises
    ------
    ImportError
        Open3D is missing, or a system library that it needs; the message says what to type.
    """
    try:
        import open3d
    except ModuleNotFoundError as error:
        raise ImportError(
            "o3d_sofnn needs Open3D here; type: pip install 'o3d_sofnn[open3d]' "
            "(any flavour of Open3D serves)"
        ) from error
    except (ImportError, OSError) as error:
        advice = "on Debian or Ubuntu type: apt-get install libusb-1.0-0 libgl1 libegl1 libopengl0 "
        advice += "libgomp1"
        if "failed to map" in str(error):
            advice = "there is too little memory for it, or nothing may run from its folder"
        raise ImportError(f"Open3D is installed but does not load ({error}); {advice}") from error
    return open3d


def checked(parts: CloudArrays, name: str) -> CloudArrays:
    """Return what a library stores per point, with coordinates and normals in float64.

    Raises
    ------
    ValueError
        Coordinates or normals are not (n, 3) real numbers; the message begins with ``name``.
    """
    points, normals = validation.check_array(parts.points, name), parts.normals
    if normals is not None:
        normals = validation.check_array(normals, f"{name}: normals")
    return CloudArrays(points, normals, parts.attributes)


def read_cloud(pcd: Any) -> CloudArrays:
    """Return the arrays of an Open3D point cloud; a cloud on a GPU is copied to the host.

    Parameters
    ----------
    pcd : open3d.geometry.PointCloud, open3d.t.geometry.PointCloud or CloudArrays
        The cloud; not changed.

    Returns
    -------
    CloudArrays
        Coordinates and normals in float64. They are copies, since callbacks may change the cloud.

    Raises
    ------
    ValueError
        ``pcd`` is not a point cloud of Open3D.
    """
    if isinstance(pcd, CloudArrays):
        return pcd
    if _is_tensor(pcd):
        return _of_stored({name: _to_host(pcd.point[name]) for name in pcd.point}, "pcd")
    stored = {"positions": np.array(pcd.points)}
    if pcd.has_normals():
        stored["normals"] = np.array(pcd.normals)
    if pcd.has_colors():
        stored["colors"] = np.array(pcd.colors)
    return _of_stored(stored, "pcd")


def write_normals(pcd: Any, normals: NDArray[np.float64]) -> None:
    """Store ``normals`` in ``pcd``; everything else in it stays as it is.

    Parameters
    ----------
    pcd : open3d.geometry.PointCloud or open3d.t.geometry.PointCloud
        Changed in place. A tensor cloud gets the number type of its positions, on its device.
    normals : numpy.ndarray, shape (n, 3)
        One row per point.

    Raises
    ------
    ValueError
        ``pcd`` has a different number of points.
    """
    o3d = import_open3d()
    tensor = _is_tensor(pcd)
    held = pcd.point if tensor else {"positions": pcd.points}
    count = len(held["positions"]) if "positions" in held else 0
    if count != len(normals):
        raise ValueError(f"pcd: changed since the call from {len(normals)} to {count} points")
    if tensor:
        values = normals.astype(_float_type(pcd))
        pcd.point["normals"] = _to_device(o3d.core.Tensor(values), pcd.device)
    else:
        pcd.normals = o3d.utility.Vector3dVector(np.ascontiguousarray(normals))


def make_mesh(pcd: Any, vertices: CloudArrays, triangles: NDArray[np.integer[Any]]) -> Any:
    """Return a triangle mesh of the family of ``pcd``.

    Parameters
    ----------
    pcd : open3d.geometry.PointCloud or open3d.t.geometry.PointCloud
        Decides the family and, for a tensor cloud, the number type and the device.
    vertices : CloudArrays
        Coordinates of the m vertices in the cloud's unit, their unit normals, and attributes of
        shape (m, k). A legacy mesh can hold "colors" only. Colours are fractions of the full
        intensity, 0 to 1, as Open3D expects them in meshes of any number type.
    triangles : numpy.ndarray, shape (f, 3)
        Vertex indices.

    Returns
    -------
    open3d.geometry.TriangleMesh or open3d.t.geometry.TriangleMesh
        The mesh, which owns its memory.
    """
    o3d = import_open3d()
    if not _is_tensor(pcd):
        mesh = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(np.ascontiguousarray(vertices.points)),
            o3d.utility.Vector3iVector(np.ascontiguousarray(triangles, dtype=np.int32)),
        )
        if vertices.normals is not None:
            normals = np.ascontiguousarray(vertices.normals)
            mesh.vertex_normals = o3d.utility.Vector3dVector(normals)
        if "colors" in vertices.attributes:
            mesh.vertex_colors = o3d.utility.Vector3dVector(vertices.attributes["colors"])
        return mesh

    def tensor(values: NDArray[Any]) -> Any:
        return _to_device(o3d.core.Tensor(np.ascontiguousarray(values)), pcd.device)

    kind = _float_type(pcd)
    mesh = o3d.t.geometry.TriangleMesh(
        tensor(vertices.points.astype(kind)), tensor(triangles.astype(np.int64))
    )
    if vertices.normals is not None:
        mesh.vertex["normals"] = tensor(vertices.normals.astype(kind))
    for name, values in vertices.attributes.items():
        mesh.vertex[name] = tensor(values)
    return mesh


def make_cloud(arrays: CloudArrays) -> Any:
    """Return a tensor point cloud on the CPU that holds ``arrays``."""
    o3d = import_open3d()
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(arrays.points))
    if arrays.normals is not None:
        cloud.point["normals"] = o3d.core.Tensor(arrays.normals)
    for name, values in arrays.attributes.items():
        cloud.point[name] = o3d.core.Tensor(np.ascontiguousarray(values))
    return cloud


def read_mesh(mesh: Any) -> tuple[CloudArrays, NDArray[np.int64]]:
    """Return the vertices of an Open3D triangle mesh, with their attributes, and the triangles.

    Parameters
    ----------
    mesh : open3d.geometry.TriangleMesh or open3d.t.geometry.TriangleMesh
        The mesh, not changed; or a pair of CloudArrays and (f, 3) triangles.

    Returns
    -------
    vertices : CloudArrays
        Coordinates, normals and attributes of the m vertices.
    triangles : numpy.ndarray, shape (f, 3)
        Vertex indices.

    Raises
    ------
    ValueError
        ``mesh`` is not a triangle mesh of Open3D.
    """
    if isinstance(mesh, tuple):
        return mesh[0], np.asarray(mesh[1]).astype(np.int64)
    o3d = import_open3d()
    if isinstance(mesh, o3d.t.geometry.TriangleMesh):
        stored = {name: _to_host(mesh.vertex[name]) for name in mesh.vertex}
        has_triangles = "indices" in mesh.triangle
        triangles = _to_host(mesh.triangle["indices"]) if has_triangles else np.zeros((0, 3))
    elif isinstance(mesh, o3d.geometry.TriangleMesh):
        stored = {"positions": np.array(mesh.vertices)}
        if mesh.has_vertex_normals():
            stored["normals"] = np.array(mesh.vertex_normals)
        if mesh.has_vertex_colors():
            stored["colors"] = np.array(mesh.vertex_colors)
        triangles = np.asarray(mesh.triangles)
    else:
        raise ValueError(f"mesh: expected an Open3D TriangleMesh, got {type(mesh).__name__}")
    return _of_stored(stored, "mesh"), triangles.astype(np.int64)


def read_search_param(search_param: Any) -> tuple[int | None, float | None]:
    """Return ``(max_nn, radius)`` of a search parameter of Open3D; None is (None, None).

    Parameters
    ----------
    search_param : open3d.geometry.KDTreeSearchParamKNN, ...Radius, ...Hybrid, or None
        Largest neighbourhood of a local fit: a number of points, a radius in the cloud's unit,
        or both.

    Raises
    ------
    ValueError
        ``search_param`` is something else, or its numbers are out of range.
    """
    if search_param is None:
        return None, None
    geometry = import_open3d().geometry
    if isinstance(search_param, geometry.KDTreeSearchParamKNN):
        max_nn, radius = search_param.knn, None
    elif isinstance(search_param, geometry.KDTreeSearchParamRadius):
        max_nn, radius = None, search_param.radius
    elif isinstance(search_param, geometry.KDTreeSearchParamHybrid):
        max_nn, radius = search_param.max_nn, search_param.radius
    else:
        raise ValueError(
            "search_param: expected a KDTreeSearchParamKNN, KDTreeSearchParamRadius or "
            f"KDTreeSearchParamHybrid, got {type(search_param).__name__}"
        )
    return (
        validation.check_integer(max_nn, "search_param: max_nn", validation.MIN_NEIGHBORS),
        validation.check_positive(radius, "search_param: radius"),
    )


def _of_stored(stored: dict[str, NDArray[Any]], name: str) -> CloudArrays:
    """Check what is stored per point of the argument ``name``, by Open3D's names."""
    points = stored.pop("positions", np.zeros((0, 3)))
    return checked(CloudArrays(points, stored.pop("normals", None), stored), name)


def _is_tensor(pcd: Any) -> bool:
    o3d = import_open3d()
    if isinstance(pcd, o3d.t.geometry.PointCloud):
        return True
    if isinstance(pcd, o3d.geometry.PointCloud):
        return False
    raise ValueError(
        "pcd: expected an open3d.geometry.PointCloud or open3d.t.geometry.PointCloud, "
        f"got {type(pcd).__name__}"
    )


def _float_type(pcd: Any) -> type[np.floating[Any]]:
    """Return the number type for coordinates that belong to the tensor cloud ``pcd``."""
    single = import_open3d().core.float32
    is_single = "positions" in pcd.point and pcd.point["positions"].dtype == single
    return np.float32 if is_single else np.float64


def _to_host(tensor: Any) -> NDArray[Any]:
    return np.array(tensor.cpu().numpy())  # a copy


def _to_device(tensor: Any, device: Any) -> Any:
    return tensor.to(device)
