"""What the benchmark measures: each function runs in a process of its own and returns figures."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Figures = dict[str, float | str]

NEIGHBORS = 30
"""Of the peers' normals, and of the graph along which Open3D orients them."""


IMPORTS = """
import time
started = time.perf_counter()
import open3d
between = time.perf_counter()
import o3d_sofnn
o3d_sofnn.estimate_normals, o3d_sofnn.reconstruct_surface  # loaded when first asked for
print(between - started, time.perf_counter() - between)
"""


def import_time(cloud: str, grid: Array) -> Figures:
    """Import Open3D, then this package, in a new interpreter."""
    command = [sys.executable, "-c", IMPORTS]
    words = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return {"open3d": float(words[-2]), "seconds": float(words[-1])}


def ours_normals(cloud: str, grid: Array) -> Figures:
    """Estimate oriented normals twice: the first call and one after it."""
    return _normals(cloud, -1, 2)


def ours_normals_1(cloud: str, grid: Array) -> Figures:
    """Estimate them with one thread."""
    return _normals(cloud, 1, 1)


def ours_normals_4(cloud: str, grid: Array) -> Figures:
    """Estimate them with four."""
    return _normals(cloud, 4, 1)


def ours_mesh(cloud: str, grid: Array) -> Figures:
    """Reconstruct a mesh from points alone."""
    return _mesh(cloud, -1)


def ours_mesh_1(cloud: str, grid: Array) -> Figures:
    """Reconstruct it with one thread."""
    return _mesh(cloud, 1)


def ours_mesh_4(cloud: str, grid: Array) -> Figures:
    """Reconstruct it with four."""
    return _mesh(cloud, 4)


def open3d_normals(cloud: str, grid: Array) -> Figures:
    """Estimate normals with Open3D, not oriented."""
    import open3d as o3d

    pcd = _cloud(cloud)
    with _Watch() as watch:
        pcd.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NEIGHBORS))
    return watch.figures


def open3d_poisson(cloud: str, grid: Array) -> Figures:
    """Reconstruct by Open3D's Poisson, given the true normals."""
    import open3d as o3d

    pcd = _cloud(cloud)
    pcd.normals = o3d.utility.Vector3dVector(np.load(cloud.replace(".npy", ".normals.npy")))
    with _Watch() as watch:
        mesh = _poisson(pcd, grid)
    return watch.figures | {"triangles": len(mesh.triangles)}


def open3d_chain(cloud: str, grid: Array) -> Figures:
    """Do what Open3D's users type: normals, orientation along tangent planes, Poisson."""
    import open3d as o3d

    pcd = _cloud(cloud)
    with _Watch() as watch:
        pcd.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NEIGHBORS))
        pcd.orient_normals_consistent_tangent_plane(NEIGHBORS)
        oriented = time.perf_counter()
        mesh = _poisson(pcd, grid)
    return watch.figures | {"triangles": len(mesh.triangles), "oriented": oriented - watch.started}


def meshlab_chain(cloud: str, grid: Array) -> Figures:
    """Run MeshLab's normals and screened Poisson."""
    import pymeshlab

    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=np.load(cloud)))
    depth, scale = int(grid[0]), float(grid[1])
    with _Watch() as watch:
        meshes.compute_normal_for_point_clouds(k=NEIGHBORS)
        # Its default of 16 threads is many times slower on a machine with fewer cores.
        meshes.generate_surface_reconstruction_screened_poisson(
            depth=depth, scale=scale, threads=os.cpu_count() or 1
        )
    return watch.figures | {"triangles": meshes.current_mesh().face_number()}


TASKS: dict[str, Callable[[str, Array], Figures]] = {
    task.__name__: task
    for task in (
        import_time,
        ours_normals,
        open3d_normals,
        ours_mesh,
        open3d_poisson,
        open3d_chain,
        meshlab_chain,
        ours_normals_1,
        ours_mesh_1,
        ours_normals_4,
        ours_mesh_4,
    )
}


class _Watch:
    """Wall and processor time of a block."""

    def __enter__(self) -> _Watch:
        self._cpu = time.process_time()
        self.started = time.perf_counter()
        return self

    def __exit__(self, *error: object) -> None:
        self.figures: Figures = {
            "seconds": time.perf_counter() - self.started,
            "cpu": time.process_time() - self._cpu,
        }


def _cloud(file: str) -> Any:
    import open3d as o3d

    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.load(file)))


def _poisson(pcd: Any, grid: Array) -> Any:
    import open3d as o3d

    create = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson
    return create(pcd, depth=int(grid[0]), scale=float(grid[1]))[0]


def _normals(cloud: str, n_threads: int, calls: int) -> Figures:
    from o3d_sofnn import estimate_normals

    pcd = _cloud(cloud)
    runs = []
    for _ in range(calls):
        with _Watch() as watch:
            _, details = estimate_normals(pcd, n_threads=n_threads, return_details=True)
        runs.append(watch.figures)
    stages = {f"stage {name}": seconds for name, seconds in details.seconds.items()}
    digest = hashlib.sha256(np.asarray(pcd.normals).tobytes()).hexdigest()
    repeat = {"second": runs[1]["cpu"]} if calls > 1 else {}
    return runs[0] | repeat | stages | {"digest": digest}


def _mesh(cloud: str, n_threads: int) -> Figures:
    from o3d_sofnn import reconstruct_surface

    pcd = _cloud(cloud)
    with _Watch() as watch:
        mesh, details = reconstruct_surface(pcd, n_threads=n_threads, return_details=True)
    stages = {f"stage {name}": seconds for name, seconds in details.seconds.items()}
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    digest = hashlib.sha256(vertices.tobytes() + triangles.tobytes()).hexdigest()
    extent = float(np.ptp(np.asarray(pcd.points), axis=0).max())
    size = {"triangles": len(triangles), "cubes": extent / details.voxel_size}
    return watch.figures | stages | size | {"digest": digest}
