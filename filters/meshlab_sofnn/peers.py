"""Reconstructions inside MeshLab, its own and ours, for ``o3d_sofnn.compare``.

Points without normals in, a mesh out; every step by ``MeshSet.apply_filter``. The comparison runs
each of these in a process of its own.
"""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from meshlab_sofnn.parameters import NORMALS, RECONSTRUCT
from meshlab_sofnn.registration import register
from o3d_sofnn.compare.peers import DEPTH, NEIGHBORS, Mesh

Array = NDArray[Any]
Chain = tuple[tuple[str, dict[str, Any]], ...]
"""Filters one after the other, with the parameters that are not MeshLab's defaults."""

_NORMALS = ("compute_normal_for_point_clouds", {"k": NEIGHBORS})
_POISSON = (
    "generate_surface_reconstruction_screened_poisson",
    # Its default of 16 threads is many times slower on a machine with fewer cores.
    {"depth": DEPTH, "threads": os.cpu_count() or 1},
)
CHAINS: dict[str, Chain] = {
    "meshlab_sofnn": ((RECONSTRUCT, {}),),
    "meshlab_sofnn_poisson": ((NORMALS, {}), _POISSON),
    "meshlab_poisson": (_NORMALS, _POISSON),
    "meshlab_ball_pivoting": (_NORMALS, ("generate_surface_reconstruction_ball_pivoting", {})),
    "meshlab_rimls": (_NORMALS, ("generate_marching_cubes_rimls", {})),
    "meshlab_apss": (_NORMALS, ("generate_marching_cubes_apss", {})),
}
"""Normals first, then the surface; the first two are ours."""


def run(points: Array, name: str) -> tuple[Mesh, float, float]:
    """Run one of ``CHAINS``.

    Parameters
    ----------
    points : (n, 3) float64
    name : str
        Of the chain.

    Returns
    -------
    Mesh, float, float
        The result, the seconds for normals, and those for normals and surface.
    """
    register()
    meshes = pymeshlab.MeshSet(verbose=False)
    meshes.add_mesh(pymeshlab.Mesh(vertex_matrix=points))
    *before, surface = CHAINS[name]
    started = time.perf_counter()
    for filter_name, parameters in before:
        meshes.apply_filter(filter_name, **parameters)
    normals_seconds = time.perf_counter() - started if before else 0.0
    # Now, because ball pivoting adds its faces to this very layer, which changes its normals.
    normals = np.array(meshes.current_mesh().vertex_normal_matrix()) if before else None
    started = time.perf_counter()
    meshes.apply_filter(surface[0], **surface[1])
    seconds = normals_seconds + time.perf_counter() - started
    mesh = meshes.current_mesh()
    return Mesh.of(mesh.vertex_matrix(), mesh.face_matrix(), normals), normals_seconds, seconds


def meshlab_sofnn(points: Array) -> Mesh:
    """Run this package as a filter."""
    return run(points, "meshlab_sofnn")[0]


def meshlab_poisson(points: Array) -> Mesh:
    """Run MeshLab's normals and screened Poisson."""
    return run(points, "meshlab_poisson")[0]


def meshlab_ball_pivoting(points: Array) -> Mesh:
    """Run MeshLab's normals and ball pivoting."""
    return run(points, "meshlab_ball_pivoting")[0]


def meshlab_rimls(points: Array) -> Mesh:
    """Run MeshLab's normals and marching cubes on robust implicit moving least squares."""
    return run(points, "meshlab_rimls")[0]


def meshlab_apss(points: Array) -> Mesh:
    """Run MeshLab's normals and marching cubes on algebraic point set surfaces."""
    return run(points, "meshlab_apss")[0]
