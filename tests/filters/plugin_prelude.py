"""What every Python that a test of the native plugin starts has at hand: prepended to its code."""

# ruff: noqa: F401 - the code of the tests uses them
import os
import sys

import meshlab_sofnn
import numpy as np
import pymeshlab
from layer_checks import assert_is_surface

from o3d_sofnn import pipeline

PLUGIN, TMP = sys.argv[1:]
RECONSTRUCT = "generate_surface_reconstruction_sofnn"
# The last is pybind11's for a value of the wrong type.
ERRORS = (pymeshlab.PyMeshLabException, pymeshlab.InvalidEnumException, RuntimeError)
NORMALS = "compute_normal_for_point_clouds_sofnn"
# Their names until 2022 are the others.
Percentage = getattr(pymeshlab, "PercentageValue", None) or pymeshlab.Percentage
Length = getattr(pymeshlab, "PureValue", None) or pymeshlab.AbsoluteValue
rng = np.random.default_rng(0)
points = rng.normal(size=(600, 3))
points = points / np.linalg.norm(points, axis=1, keepdims=True) * (1.0, 0.8, 0.6) + (400, 30, 0)
colors = rng.integers(0, 256, (600, 4)).astype(np.uint8)
ms = pymeshlab.MeshSet()
ms.add_mesh(pymeshlab.Mesh(points, v_color_matrix=(colors + 0.5) / 255), "cloud")


def state():
    ms.save_filter_script(TMP + "/state.mlx")
    fields = ("vertex", "transformed_vertex", "vertex_normal", "vertex_color", "face")
    meshes = [
        (mesh.label(), *(getattr(mesh, field + "_matrix")().tobytes() for field in fields))
        for mesh in (ms.mesh(i) for i in range(10) if ms.mesh_id_exists(i))
    ]
    return ms.current_mesh_id() if meshes else None, meshes, open(TMP + "/state.mlx").read()


def fails(message, name=RECONSTRUCT, **params):
    before = state()
    error = None
    try:
        ms.apply_filter(name, **params)
    except ERRORS as caught:
        error = str(caught)
    assert error is not None, f"no error, expected {message!r}"
    assert message in error, f"expected {message!r}, got {error!r}"
    assert state() == before
