"""The filters callable by name, like PyMeshLab's own, and taken back."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from layer_checks import assert_is_surface

from o3d_sofnn import pipeline

pymeshlab = pytest.importorskip("pymeshlab", reason="PyMeshLab is not installed")
import meshlab_sofnn  # noqa: E402 - it needs PyMeshLab

pytestmark = pytest.mark.usefixtures("unregistered")

RECONSTRUCT = "generate_surface_reconstruction_sofnn"
NORMALS = "compute_normal_for_point_clouds_sofnn"


def test_registered_filters_work_like_built_in_ones(ms: Any, points: Any) -> None:
    assert meshlab_sofnn.register(plugin=False) == "python"
    assert meshlab_sofnn.register(plugin=False) == "python"
    expected = pipeline.reconstruct_surface(points)
    summary = ms.generate_surface_reconstruction_sofnn()
    assert summary["voxel_size"] == expected.voxel_size
    assert_is_surface(ms.current_mesh(), expected)
    ms.set_current_mesh(0)
    assert ms.apply_filter(RECONSTRUCT, n_threads=1)["watertight"] is True
    assert_is_surface(ms.current_mesh(), expected)
    ms.set_current_mesh(0)
    assert ms.compute_normal_for_point_clouds_sofnn()["outliers"] >= 0
    ms.apply_filter(NORMALS, orientation="direction")
    with pytest.raises(TypeError):
        ms.generate_surface_reconstruction_sofnn(5)

    values = ms.filter_parameter_values(RECONSTRUCT, voxel_size=pymeshlab.PercentageValue(1))
    assert list(values) == [
        *("depth", "voxel_size", "use_normals", "closed", "trim", "target_triangles", "precision"),
        *("orientation", "viewpos", "direction", "max_nn", "radius", "n_threads"),
    ]
    # MeshLab keeps lengths in single precision.
    diagonal = ms.current_mesh().bounding_box().diagonal()
    assert values["voxel_size"] == pytest.approx(0.01 * diagonal, rel=1e-6)
    assert ms.filter_parameter_values(NORMALS)["orientation"] == 0

    assert ms.filter_parameter_values("compute_normal_for_point_clouds", k=7)["k"] == 7
    ms.apply_filter("compute_normal_for_point_clouds", k=7)
    with pytest.raises(pymeshlab.PyMeshLabException, match="does not exist"):
        ms.apply_filter("no_such_filter")


def test_unregister_takes_everything_back(ms: Any) -> None:
    originals = dict(vars(pymeshlab.MeshSet))
    meshlab_sofnn.unregister()
    meshlab_sofnn.register(plugin=False)
    assert hasattr(ms, RECONSTRUCT)
    meshlab_sofnn.unregister()
    meshlab_sofnn.unregister()
    assert dict(vars(pymeshlab.MeshSet)) == originals
    with pytest.raises(pymeshlab.PyMeshLabException, match="does not exist"):
        ms.apply_filter(RECONSTRUCT)


def test_the_algorithm_never_imports_pymeshlab(tmp_path: Path) -> None:
    code = (
        "import sys, o3d_sofnn.pipeline, o3d_sofnn.operators.surfaces, o3d_sofnn.files.point_files;"
        "sys.exit('pymeshlab' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=False)
    assert run.returncode == 0


def test_a_users_script(tmp_path: Path) -> None:
    samples = Path(pymeshlab.__file__).parent / "tests" / "sample_meshes"

    ms = pymeshlab.MeshSet()
    ms.load_new_mesh(str(samples / "chameleon.pts"))
    meshlab_sofnn.register(plugin=False)
    ms.compute_normal_for_point_clouds_sofnn()
    ms.generate_surface_reconstruction_sofnn()
    ms.save_current_mesh(str(tmp_path / "chameleon.ply"))

    ms.load_new_mesh(str(tmp_path / "chameleon.ply"))
    assert ms.current_mesh().face_number() == ms.mesh(1).face_number() > 0
