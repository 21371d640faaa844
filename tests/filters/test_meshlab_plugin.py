"""The native MeshLab plugin in a real PyMeshLab, calling back into its Python.

Every test runs a Python of its own, because PyMeshLab cannot unload a plugin.
"""

from __future__ import annotations

import re
from typing import Any

from native_plugin import PLUGIN

REGISTERED = 'assert meshlab_sofnn.register(PLUGIN) == "native"\n'


def test_sources_are_thin_and_gpl() -> None:
    sources = sorted(PLUGIN.glob("*.cpp")) + sorted(PLUGIN.glob("*.h"))
    assert sum(len(path.read_text().splitlines()) for path in sources) < 300
    for path in [*sources, PLUGIN / "CMakeLists.txt"]:
        assert "SPDX-License-Identifier: GPL-3.0-or-later" in path.read_text()


def test_filters_are_listed_and_run_in_this_process(check: Any) -> None:
    out = check(
        REGISTERED
        + """
assert {RECONSTRUCT, NORMALS} <= set(pymeshlab.filter_list())
pymeshlab.print_filter_parameter_list(RECONSTRUCT)
expected = pipeline.reconstruct_surface(points)
ms.set_verbosity(True)
summary = ms.generate_surface_reconstruction_sofnn()
ms.set_verbosity(False)
assert ms.current_mesh().label() == "SOFNN mesh", ms.current_mesh().label()
assert ms.current_mesh_id() == 1 and ms.mesh(0).face_number() == 0
assert_is_surface(ms.current_mesh(), expected)
mixed = np.rint(expected.source_weights @ colors.astype(float))
np.testing.assert_array_equal(np.rint(ms.current_mesh().vertex_color_matrix() * 255), mixed)
assert summary["voxel_size"] == expected.voxel_size and summary["watertight"] is True
assert summary["ignored_points"] == 0 and summary["offset_points"] == expected.offset_points

ms.set_current_mesh(0)
ms.compute_normal_for_point_clouds_sofnn(orientation="direction", direction=np.array([1.0, 0, 0]))
np.testing.assert_array_equal(
    ms.current_mesh().vertex_normal_matrix(),
    pipeline.estimate_normals(points, towards=np.array([1.0, 0, 0])).normals,
)
assert ms.filter_parameter_values(NORMALS)["orientation"] == 0
"""
    )
    assert "voxel_size" in out
    assert re.search(r"\[ *\d+% *\]", out), "progress is shown"


def test_both_ways_to_the_filters_agree(check: Any) -> None:
    check(
        REGISTERED
        + """
from meshlab_sofnn import parameters
turn = np.array([[0, -2, 0, 1 / 3], [2, 0, 0, 1000 + 1 / 7], [0, 0, 2, -5], [0, 0, 0, 1.0]])
ms.apply_filter("set_matrix", transformmatrix=turn, freeze=False)
ms.apply_filter(NORMALS)
native = ms.mesh(0).vertex_normal_matrix()
ms.apply_filter(RECONSTRUCT, voxel_size=Percentage(7))
mesh = ms.current_mesh()
world = np.ascontiguousarray(ms.mesh(0).transformed_vertex_matrix())
expected = pipeline.estimate_normals(world).normals
np.testing.assert_allclose(native @ turn[:3, :3].T / 2, expected, atol=1e-12)
ms.set_current_mesh(0)
size = ms.filter_parameter_values(RECONSTRUCT, voxel_size=Percentage(7))["voxel_size"]
assert_is_surface(mesh, pipeline.reconstruct_surface(world, voxel_size=size))
for name in parameters.PARAMETERS:
    values = ms.filter_parameter_values(name)
    assert list(values) == [parameter.name for parameter in parameters.PARAMETERS[name]]
    for parameter in parameters.PARAMETERS[name]:
        np.testing.assert_array_equal(values[parameter.name], parameter.default)
if hasattr(pymeshlab, "PercentageValue"):
    meshlab_sofnn.register(plugin=False)
    python = ms.filter_parameter_values(RECONSTRUCT, voxel_size=Percentage(7))["voxel_size"]
    np.testing.assert_allclose(python, size, rtol=1e-6)
"""
    )


def test_errors_leave_the_meshset_unchanged(check: Any) -> None:
    check(
        REGISTERED
        + """
fails("Parameter voxelsize not found", voxelsize=1)
fails("depth: expected an integer from 1 to 16, got -1", depth=-1)
fails("depth: expected an integer from 1 to 16, got 17", depth=17)
fails("voxel_size: expected", voxel_size=Length(-1))
fails("radius: expected", radius=Length(-1))
fails("n_threads: expected", n_threads=0)
fails("", depth="deep")
fails("", voxel_size=0.5)
fails('trim: expected a number from 0 to 1 or "auto", got 1.5', trim=1.5)
fails("depth and voxel_size", depth=4, voxel_size=Percentage(1))
fails("600 of 600 vertices without", use_normals=True)
fails("max_nn: expected an integer from 6 to 2147483647, got 3", NORMALS, max_nn=3)
fails("up", NORMALS, orientation="up")
fails("viewpoint: expected", NORMALS, orientation="viewpoint", viewpos=np.full(3, np.nan))
fails("towards: expected", NORMALS, orientation="direction", direction=np.zeros(3))
ms.add_mesh(pymeshlab.Mesh(points[:3]), "few")
fails("at least 4 finite points, got 3")
ms.add_mesh(pymeshlab.Mesh(points, np.array([[0, 1, 2]], dtype=np.int32)), "mesh")
fails("Layer 'mesh': expected a point cloud, got 600 vertices and 1 faces")
fails("expected a point cloud", NORMALS)
ms.set_current_mesh(0)
ms.apply_filter("set_selection_all")
ms.apply_filter("meshing_remove_selected_vertices")
fails("Layer 'cloud': expected a point cloud, got 0 vertices and 0 faces")
ms.clear()
fails("requires at least one mesh")
"""
    )


def test_ctrl_c_ends_the_filter(check: Any) -> None:
    check(
        REGISTERED
        + """
from meshlab_sofnn import engine

def interrupted(*args, **kwargs):
    raise KeyboardInterrupt

engine.pipeline.reconstruct_surface = interrupted
fails("interrupted")
"""
    )


def test_registering_again_and_unregistering(check: Any) -> None:
    check(
        REGISTERED * 2
        + """
meshlab_sofnn.unregister()
meshlab_sofnn.unregister()
assert not hasattr(ms, RECONSTRUCT)
assert RECONSTRUCT in pymeshlab.filter_list()
os.environ["MESHLAB_SOFNN_PLUGIN"] = PLUGIN
assert meshlab_sofnn.register() == "native"
ms.generate_surface_reconstruction_sofnn()
assert_is_surface(ms.current_mesh(), pipeline.reconstruct_surface(points))
"""
    )


def test_a_users_script_with_an_mlx_file(check: Any) -> None:
    check(
        """
import pathlib
samples = pathlib.Path(pymeshlab.__file__).parent / "tests" / "sample_meshes"

ms = pymeshlab.MeshSet()
ms.load_new_mesh(str(samples / "chameleon.pts"))
meshlab_sofnn.register(PLUGIN)
ms.generate_surface_reconstruction_sofnn(trim=0.01)
ms.save_current_mesh(TMP + "/chameleon.ply")
ms.save_filter_script(TMP + "/chameleon.mlx")

again = pymeshlab.MeshSet()
again.load_new_mesh(str(samples / "chameleon.pts"))
again.load_filter_script(TMP + "/chameleon.mlx")
again.apply_filter_script()
first, second = ms.current_mesh(), again.current_mesh()
assert second.label() == "SOFNN mesh" and second.face_number() > 0
assert (first.vertex_matrix() == second.vertex_matrix()).all()
assert (first.face_matrix() == second.face_matrix()).all()
"""
    )
