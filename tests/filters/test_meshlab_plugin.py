"""The native MeshLab plugin: built against MeshLab's headers and loaded into a real PyMeshLab.

It needs MESHLAB_SRC, the folder ``src`` of MeshLab's sources, and a PyMeshLab of the same version:
in this Python or in the one that MESHLAB_PYTHON names. Every test runs a Python of its own, because
PyMeshLab cannot unload a plugin.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PLUGIN = ROOT / "filters" / "meshlab_plugin"
SOURCE = os.environ.get("MESHLAB_SRC", "")
PYTHON = os.environ.get("MESHLAB_PYTHON", sys.executable)

PRELUDE = """
import os, sys
import numpy as np
import pymeshlab
import meshlab_sofnn
from o3d_sofnn import pipeline

PLUGIN, TMP = sys.argv[1:]
RECONSTRUCT = "generate_surface_reconstruction_sofnn"
NORMALS = "compute_normal_for_point_clouds_sofnn"
Percentage = getattr(pymeshlab, "PercentageValue", None) or pymeshlab.Percentage
rng = np.random.default_rng(0)
points = rng.normal(size=(600, 3))
points = points / np.linalg.norm(points, axis=1, keepdims=True) * (1.0, 0.8, 0.6) + (400, 30, 0)
colors = rng.integers(0, 256, (600, 4)).astype(np.uint8)
ms = pymeshlab.MeshSet()
ms.add_mesh(pymeshlab.Mesh(points, v_color_matrix=(colors + 0.5) / 255), "cloud")

def state():
    fields = ("vertex_matrix", "vertex_normal_matrix", "vertex_color_matrix", "face_matrix")
    return ms.current_mesh_id(), [
        (ms.mesh(i).label(), *(getattr(ms.mesh(i), field)().tobytes() for field in fields))
        for i in range(10) if ms.mesh_id_exists(i)
    ]

def is_surface(mesh, expected):
    np.testing.assert_array_equal(mesh.vertex_matrix(), expected.vertices)
    np.testing.assert_array_equal(mesh.face_matrix(), expected.triangles)
    np.testing.assert_array_equal(mesh.vertex_normal_matrix(), expected.vertex_normals)
    np.testing.assert_array_equal(mesh.vertex_scalar_array(), expected.confidence)

def fails(message, name=RECONSTRUCT, **params):
    before = state()
    try:
        ms.apply_filter(name, **params)
    except pymeshlab.PyMeshLabException as error:
        assert message in str(error), error
    else:
        raise AssertionError("no error: " + message)
    assert state() == before

"""

REGISTERED = 'assert meshlab_sofnn.register(PLUGIN) == "native"\n'


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the two packages under test and nothing else of this Python."""
    folder = tmp_path_factory.mktemp("packages")
    for name in ("o3d_sofnn", "meshlab_sofnn"):
        spec = importlib.util.find_spec(name)
        assert spec is not None
        assert spec.origin is not None
        (folder / name).symlink_to(Path(spec.origin).parent)
    return folder


def run(packages: Path, code: str, *arguments: object, **environment: str) -> Any:
    """Run code in the Python that has the fitting PyMeshLab."""
    return subprocess.run(
        [PYTHON, "-c", code, *map(str, arguments)],
        cwd=packages,
        env={**os.environ, "PYTHONPATH": str(packages), **environment},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def pymeshlab_build(packages: Path) -> tuple[str, Path]:
    """Return the MeshLab version in PyMeshLab and the library to link."""
    found = run(packages, "import pymeshlab as p; p.print_pymeshlab_version(); print(p.__file__)")
    version = re.search(r"based on MeshLab (\S+)", found.stdout)
    if found.returncode != 0 or version is None:
        pytest.skip(f"no PyMeshLab in {PYTHON}: {found.stderr.strip()[-200:]}")
    folder = Path(found.stdout.strip().splitlines()[-1]).parent
    return version[1], folder / "lib" / "libmeshlab-common.so"


@pytest.fixture(scope="module")
def plugin(packages: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    if not SOURCE:
        pytest.skip("MESHLAB_SRC does not name the folder src of MeshLab's sources")
    if sys.platform != "linux" or shutil.which("cmake") is None:
        pytest.skip("the plugin's test needs Linux and cmake")
    version, library = pymeshlab_build(packages)
    headers = (Path(SOURCE).parent / "ML_VERSION").read_text().strip()
    # MeshLab compares this much: year and month, or its first digit.
    if headers[:6] != version[:6]:
        pytest.skip(f"MESHLAB_SRC is MeshLab {headers}, but PyMeshLab is built on {version}")
    build = tmp_path_factory.mktemp("plugin")
    options = {
        "CMAKE_BUILD_TYPE": "Release",
        "CMAKE_CXX_FLAGS": "-Wall -Wextra -Werror",
        "MESHLAB_SRC": SOURCE,
        "MESHLAB_COMMON_LIB": library,
        "MESHLAB_VERSION": version,
        "MESHLAB_SCALAR": "double",
    }
    defines = [f"-D{name}={value}" for name, value in options.items()]
    subprocess.run(["cmake", "-S", PLUGIN, "-B", build, *defines], check=True)
    subprocess.run(["cmake", "--build", build], check=True)
    return build / "libfilter_sofnn.so"


@pytest.fixture
def check(packages: Path, plugin: Path, tmp_path: Path) -> Any:
    """Return a function that runs code in a Python that can load the plugin."""

    def check(code: str, **environment: str) -> str:
        done = run(packages, PRELUDE + code, plugin, tmp_path, **environment)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    return check


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
is_surface(ms.current_mesh(), expected)
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
is_surface(mesh, pipeline.reconstruct_surface(world, voxel_size=size))
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
fails("trim: expected a number from 0 to 1, got 1.5", trim=1.5)
fails("depth and voxel_size", depth=4, voxel_size=Percentage(1))
fails("600 of 600 vertices without", use_normals=True)
fails("max_nn: expected an integer >= 6, got 3", NORMALS, max_nn=3)
fails("towards: expected", NORMALS, orientation="direction", direction=np.zeros(3))
ms.add_mesh(pymeshlab.Mesh(points[:3]), "few")
fails("at least 4 finite points, got 3")
ms.add_mesh(pymeshlab.Mesh(points, np.array([[0, 1, 2]], dtype=np.int32)), "mesh")
fails("Layer 'mesh': expected a point cloud, got 600 vertices and 1 faces")
fails("expected a point cloud", NORMALS)
ms.clear()
try:
    ms.apply_filter(RECONSTRUCT)
except pymeshlab.PyMeshLabException as error:
    assert "requires at least one mesh" in str(error)
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
is_surface(ms.current_mesh(), pipeline.reconstruct_surface(points))
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


def program(folder: Path, text: str) -> str:
    path = folder / "o3d-sofnn"
    path.write_text("#!/bin/sh\n" + text)
    path.chmod(0o755)
    return str(path)


def test_the_program_runs_where_no_python_has_set_an_engine(check: Any, tmp_path: Path) -> None:
    pytest.importorskip("open3d")
    home = packages
    command = f"PYTHONPATH='{home}' exec '{sys.executable}' -m o3d_sofnn \"$@\"\n"
    check(
        """
pymeshlab.load_plugin(PLUGIN)
ms.set_verbosity(True)
ms.apply_filter(RECONSTRUCT)
ms.set_verbosity(False)
mesh, expected = ms.current_mesh(), pipeline.reconstruct_surface(points)
assert ms.current_mesh_id() == 1 and mesh.label() == "SOFNN mesh"
# The program runs in another Python, whose numpy may round differently.
np.testing.assert_allclose(mesh.vertex_matrix(), expected.vertices, rtol=0, atol=1e-9)
np.testing.assert_array_equal(mesh.face_matrix(), expected.triangles)
np.testing.assert_allclose(mesh.vertex_normal_matrix(), expected.vertex_normals, atol=1e-9)
mixed = expected.source_weights @ colors.astype(float)
assert abs(mesh.vertex_color_matrix() * 255 - mixed)[:, :3].max() < 1.001
ms.set_current_mesh(0)
ms.apply_filter(NORMALS, orientation="viewpoint", viewpos=np.array([400.0, 30.0, -9.0]))
np.testing.assert_allclose(
    ms.current_mesh().vertex_normal_matrix(),
    pipeline.estimate_normals(points, viewpoint=np.array([400.0, 30.0, -9.0])).normals,
    atol=1e-9,
)
fails("depth", depth=99)
""",
        O3D_SOFNN_PROGRAM=program(tmp_path, command),
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "The program 'o3d-sofnn-missing' was not found"),
        ("echo 'o3d-sofnn: error: no luck' >&2; exit 2\n", "o3d-sofnn: error: no luck"),
        ("exit 1\n", "failed"),
        ("kill -9 $$\n", "failed"),
        ("exit 0\n", "out.ply"),
    ],
)
def test_a_program_that_fails(check: Any, tmp_path: Path, text: str | None, message: str) -> None:
    name = "o3d-sofnn-missing" if text is None else program(tmp_path, text)
    check(
        f"pymeshlab.load_plugin(PLUGIN)\nfails({message!r})\nfails({message!r}, NORMALS)\n",
        O3D_SOFNN_PROGRAM=name,
    )
