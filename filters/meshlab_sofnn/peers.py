"""What MeshLab users have instead of the SOFNN filters: peers for ``o3d_sofnn.compare``.

Points without normals in, a mesh out. The comparison runs each of these in a process of its own.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from o3d_sofnn.compare.peers import DEPTH, NEIGHBORS, Mesh

Array = NDArray[Any]


def meshlab_poisson(points: Array) -> Mesh:
    """Run MeshLab's normals and screened Poisson."""
    meshes, normals = _with_normals(points)
    # Its default of 16 threads is many times slower on a machine with fewer cores.
    meshes.generate_surface_reconstruction_screened_poisson(
        depth=DEPTH, threads=os.cpu_count() or 1
    )
    return _mesh(meshes, normals)


def meshlab_ball_pivoting(points: Array) -> Mesh:
    """Run MeshLab's normals and ball pivoting."""
    meshes, normals = _with_normals(points)
    meshes.generate_surface_reconstruction_ball_pivoting()
    return _mesh(meshes, normals)


def meshlab_rimls(points: Array) -> Mesh:
    """Run MeshLab's normals and marching cubes on robust implicit moving least squares."""
    meshes, normals = _with_normals(points)
    meshes.generate_marching_cubes_rimls()
    return _mesh(meshes, normals)


def _with_normals(points: Array) -> tuple[Any, Array]:
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points))
    meshes.compute_normal_for_point_clouds(k=NEIGHBORS)
    return meshes, np.array(meshes.current_mesh().vertex_normal_matrix(), order="C")


def _mesh(meshes: Any, normals: Array) -> Mesh:
    mesh = meshes.current_mesh()
    return Mesh.of(mesh.vertex_matrix(), mesh.face_matrix(), normals)
