"""Our operators and their peers behind one call: points without normals in, a mesh out."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

NEIGHBORS = 30
"""Of the peers' normals, and of the graph along which Open3D orients them."""
DEPTH = 9
"""Octree depth of both Poisson reconstructions."""
BALLS = (1.5, 3.0, 6.0)
"""Radii of Open3D's ball pivoting, over the mean distance of neighbouring points."""
ALPHA = 4.0
"""Radius of the alpha shape, over the mean distance of neighbouring points."""


@dataclass(frozen=True)
class Mesh:
    """What a method makes of points.

    Attributes
    ----------
    vertices : (m, 3) float64
    triangles : (f, 3) int64
    normals : (n, 3) float64, optional
        At the points, oriented; None when the method has none.
    """

    vertices: Array
    triangles: Array
    normals: Array | None


def ours(points: Array) -> Mesh:
    """Run this package with its defaults."""
    import o3d_sofnn

    mesh, details = o3d_sofnn.reconstruct_surface(_cloud(points), return_details=True)
    return _from_open3d(mesh, details.normals.normals)


def open3d_poisson(points: Array) -> Mesh:
    """Run Open3D's chain: plane normals, tangent-plane orientation, Poisson."""
    import open3d as o3d

    pcd = _oriented(points)
    mesh, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(pcd, depth=DEPTH)
    return _from_open3d(mesh, pcd.normals)


def open3d_ball_pivoting(points: Array) -> Mesh:
    """Run Open3D's chain with ball pivoting."""
    import open3d as o3d

    pcd = _oriented(points)
    radii = o3d.utility.DoubleVector([ball * _spacing(pcd) for ball in BALLS])
    mesh = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(pcd, radii)
    return _from_open3d(mesh, pcd.normals)


def open3d_alpha_shape(points: Array) -> Mesh:
    """Run Open3D's alpha shape, which needs no normals."""
    import open3d as o3d

    pcd = _cloud(points)
    alpha = ALPHA * _spacing(pcd)
    mesh = o3d.geometry.TriangleMesh.create_from_point_cloud_alpha_shape(pcd, alpha)
    return _from_open3d(mesh, None)


def meshlab_poisson(points: Array) -> Mesh:
    """Run MeshLab's normals and screened Poisson."""
    meshes = _meshlab(points)
    normals = meshes.current_mesh().vertex_normal_matrix()
    # Its default of 16 threads is many times slower on a machine with fewer cores.
    meshes.generate_surface_reconstruction_screened_poisson(
        depth=DEPTH, threads=os.cpu_count() or 1
    )
    return _from_meshlab(meshes, normals)


def meshlab_ball_pivoting(points: Array) -> Mesh:
    """Run MeshLab's normals and ball pivoting."""
    meshes = _meshlab(points)
    normals = meshes.current_mesh().vertex_normal_matrix()
    meshes.generate_surface_reconstruction_ball_pivoting()
    return _from_meshlab(meshes, normals)


METHODS: dict[str, Callable[[Array], Mesh]] = {
    method.__name__: method
    for method in (
        ours,
        open3d_poisson,
        open3d_ball_pivoting,
        open3d_alpha_shape,
        meshlab_poisson,
        meshlab_ball_pivoting,
    )
}


def _cloud(points: Array) -> Any:
    import open3d as o3d

    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))


def _oriented(points: Array) -> Any:
    import open3d as o3d

    pcd = _cloud(points)
    pcd.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NEIGHBORS))
    pcd.orient_normals_consistent_tangent_plane(NEIGHBORS)
    return pcd


def _spacing(pcd: Any) -> float:
    return float(np.mean(pcd.compute_nearest_neighbor_distance()))


def _from_open3d(mesh: Any, normals: Any) -> Mesh:
    return _used(
        np.asarray(mesh.vertices),
        np.asarray(mesh.triangles),
        None if normals is None else np.array(normals),
    )


def _meshlab(points: Array) -> Any:
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points))
    meshes.compute_normal_for_point_clouds(k=NEIGHBORS)
    return meshes


def _from_meshlab(meshes: Any, normals: Array) -> Mesh:
    mesh = meshes.current_mesh()
    return _used(mesh.vertex_matrix(), mesh.face_matrix(), np.array(normals, order="C"))


def _used(vertices: Array, triangles: Array, normals: Array | None) -> Mesh:
    """Leave out vertices without triangles: some methods keep all points."""
    if not len(triangles):
        raise RuntimeError("the mesh has no triangles")
    kept, compact = np.unique(triangles, return_inverse=True)
    return Mesh(np.array(vertices[kept], order="C"), compact.reshape(-1, 3).astype(int), normals)
