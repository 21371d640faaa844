"""Our operator and Open3D's alternatives: points without normals in, a mesh out.

MeshLab's methods are in ``meshlab_sofnn.peers``: this package never imports PyMeshLab.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import adapters

Array = NDArray[Any]

NEIGHBORS = 30
"""Number of neighbours for the normals, and in the graph along which they are oriented."""
DEPTH = 9
"""Octree depth of Poisson reconstruction."""
BALLS = (1.5, 3.0, 6.0)
"""Radii of ball pivoting, divided by the mean distance between neighbouring points."""
ALPHA = 4.0
"""Radius of the alpha shape, divided by the mean distance between neighbouring points."""


@dataclass(frozen=True)
class Mesh:
    """The result of a method.

    Attributes
    ----------
    vertices : (m, 3) float64
        Vertices, all of them in use.
    triangles : (f, 3) int64
        Vertex indices.
    normals : (n, 3) float64, or None
        Oriented normals at the points; None if the method has none.
    """

    vertices: Array
    triangles: Array
    normals: Array | None

    @classmethod
    def of(cls, vertices: Array, triangles: Array, normals: Array | None) -> Mesh:
        """Return copies in C order, without triangles at infinity and unused vertices.

        On noise, MeshLab's marching cubes leaves vertices without a position; ball pivoting keeps
        all points.

        Raises
        ------
        RuntimeError
            There are no triangles.
        """
        placed = np.asarray(np.isfinite(vertices).all(axis=1))
        triangles = triangles[placed[triangles].all(axis=1)]
        if not len(triangles):
            raise RuntimeError("the mesh has no triangles")
        kept, compact = np.unique(triangles, return_inverse=True)
        return cls(
            np.array(vertices[kept], dtype=np.float64, order="C"),
            compact.reshape(-1, 3).astype(np.int64),
            None if normals is None else np.array(normals, dtype=np.float64, order="C"),
        )


def ours(points: Array) -> Mesh:
    """Run this package with its defaults."""
    from o3d_sofnn.operators.surfaces import reconstruct_surface  # needs all of the package

    mesh, details = reconstruct_surface(_cloud(points), return_details=True)
    return _from_open3d(mesh, details.normals.normals)


def open3d_poisson(points: Array) -> Mesh:
    """Run Open3D's chain: plane normals, tangent-plane orientation, Poisson."""
    pcd = _oriented(points)
    geometry = adapters.import_open3d().geometry
    mesh, _ = geometry.TriangleMesh.create_from_point_cloud_poisson(pcd, depth=DEPTH)
    return _from_open3d(mesh, pcd.normals)


def open3d_ball_pivoting(points: Array) -> Mesh:
    """Run Open3D's chain with ball pivoting."""
    o3d = adapters.import_open3d()
    pcd = _oriented(points)
    radii = o3d.utility.DoubleVector([ball * _spacing(pcd) for ball in BALLS])
    mesh = o3d.geometry.TriangleMesh.create_from_point_cloud_ball_pivoting(pcd, radii)
    return _from_open3d(mesh, pcd.normals)


def open3d_alpha_shape(points: Array) -> Mesh:
    """Run Open3D's alpha shape, which needs no normals."""
    pcd = _cloud(points)
    alpha = ALPHA * _spacing(pcd)
    geometry = adapters.import_open3d().geometry
    mesh = geometry.TriangleMesh.create_from_point_cloud_alpha_shape(pcd, alpha)
    return _from_open3d(mesh, None)


def plane_normals(points: Array) -> Array:
    """Return the normals of Open3D's plane fits, (n, 3), with arbitrary signs."""
    geometry = adapters.import_open3d().geometry
    pcd = _cloud(points)
    pcd.estimate_normals(geometry.KDTreeSearchParamKNN(NEIGHBORS))
    return np.array(pcd.normals)


def simplify(mesh: Mesh, count: int) -> Mesh:
    """Return a mesh of the same shape with about ``count`` triangles, for a quick look."""
    if len(mesh.triangles) <= count:
        return mesh
    o3d = adapters.import_open3d()
    full = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(mesh.vertices),
        o3d.utility.Vector3iVector(mesh.triangles.astype(np.int32)),
    )
    return _from_open3d(full.simplify_quadric_decimation(count), None)


def _cloud(points: Array) -> Any:
    o3d = adapters.import_open3d()
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))


def _oriented(points: Array) -> Any:
    geometry = adapters.import_open3d().geometry
    pcd = _cloud(points)
    pcd.estimate_normals(geometry.KDTreeSearchParamKNN(NEIGHBORS))
    pcd.orient_normals_consistent_tangent_plane(NEIGHBORS)
    return pcd


def _spacing(pcd: Any) -> float:
    return float(np.mean(pcd.compute_nearest_neighbor_distance()))


def _from_open3d(mesh: Any, normals: Any) -> Mesh:
    return Mesh.of(
        np.asarray(mesh.vertices),
        np.asarray(mesh.triangles),
        None if normals is None else np.asarray(normals),
    )
