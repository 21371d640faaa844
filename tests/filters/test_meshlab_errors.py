"""What the filters for PyMeshLab refuse, and that the MeshSet is unchanged then."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes
from numpy.typing import NDArray

pymeshlab = pytest.importorskip("pymeshlab", reason="PyMeshLab is not installed")
import meshlab_sofnn  # noqa: E402 - it needs PyMeshLab
from meshlab_sofnn import filters  # noqa: E402

pytestmark = pytest.mark.usefixtures("unregistered")

RECONSTRUCT = "generate_surface_reconstruction_sofnn"
NORMALS = "compute_normal_for_point_clouds_sofnn"


BAD = [
    (RECONSTRUCT, {"voxelsize": 1}, "Parameter voxelsize not found for filter generate_"),
    (RECONSTRUCT, {"Depth": 5}, "Parameter Depth not found"),
    (RECONSTRUCT, {"progress": print}, "Parameter progress not found"),
    (RECONSTRUCT, {"voxel_size": 0.1}, "voxel_size: expected pymeshlab.PercentageValue"),
    (RECONSTRUCT, {"voxel_size": pymeshlab.PureValue(-1)}, "voxel_size: expected"),
    (RECONSTRUCT, {"depth": 5, "voxel_size": pymeshlab.PureValue(1)}, "depth and voxel_size"),
    (RECONSTRUCT, {"depth": -1}, "depth: expected an integer from 1 to 16, got -1"),
    (RECONSTRUCT, {"depth": 17}, "depth: expected"),
    (RECONSTRUCT, {"depth": 5.0}, "Parameter depth: expected an integer, got 5.0"),
    (RECONSTRUCT, {"depth": True}, "Parameter depth: expected an integer, got True"),
    (RECONSTRUCT, {"trim": 1.5}, 'trim: expected a number from 0 to 1 or "auto", got 1.5'),
    (RECONSTRUCT, {"trim": "much"}, "trim: expected a number or \"auto\", got 'much'"),
    (RECONSTRUCT, {"trim": "auto", "closed": "no"}, "trim and closed"),
    (RECONSTRUCT, {"use_normals": 1}, "Parameter use_normals: expected True or False, got 1"),
    (NORMALS, {"max_nn": 3}, "max_nn: expected an integer from 6 to"),
    (NORMALS, {"n_threads": 0}, "n_threads: expected"),
    (NORMALS, {"radius": pymeshlab.PureValue(-1)}, "radius: expected"),
    (NORMALS, {"orientation": "up"}, "Enum 'up' not found. Possible values are 'automatic'"),
    (NORMALS, {"orientation": 3}, "Enum 3 not valid"),
    (NORMALS, {"viewpos": (1, 2)}, "Parameter viewpos: expected three finite numbers"),
    (NORMALS, {"viewpos": "here"}, "Parameter viewpos: expected three finite numbers"),
    (NORMALS, {"viewpos": (1, 2, np.nan)}, "viewpos: expected three finite numbers"),
    (NORMALS, {"viewpos": (10**400, 0, 0)}, "viewpos: expected three finite numbers"),
    (NORMALS, {"viewpos": None}, "viewpos: expected three finite numbers, got None"),
    (NORMALS, {"orientation": None}, "Parameter orientation: expected an integer, got None"),
    (NORMALS, {"orientation": -(10**5000)}, "Enum a value of type int not valid"),
    (RECONSTRUCT, {"depth": 10**400}, "depth: expected an integer from 1 to 16, got 1000"),
    (RECONSTRUCT, {"trim": 10**400}, 'trim: expected a number or "auto", got 1000'),
    (RECONSTRUCT, {"n_threads": 2**31}, "n_threads: expected"),
    (NORMALS, {"orientation": "direction", "direction": (0, 0, 0)}, "towards: expected"),
]


@pytest.mark.parametrize(("name", "params", "message"), BAD)
def test_bad_parameters(ms: Any, name: str, params: Any, message: str, state: Any) -> None:
    meshlab_sofnn.register(plugin=False)
    before = state(ms)
    with pytest.raises(pymeshlab.PyMeshLabException) as caught:
        ms.apply_filter(name, **params)
    assert message in str(caught.value)
    assert isinstance(caught.value, pymeshlab.InvalidEnumException) == ("Enum" in message)
    assert state(ms) == before


@pytest.mark.parametrize("run", [meshlab_sofnn.reconstruct, meshlab_sofnn.estimate_normals])
@pytest.mark.parametrize("kind", [MemoryError, RuntimeError, IndexError])
def test_whatever_fails_is_a_failed_filter(
    ms: Any, run: Any, kind: Any, state: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise kind("somewhere within")

    before = state(ms)
    for name in ("surface_of_cloud", "normals_of_cloud"):
        monkeypatch.setattr(filters, name, fail)
    message = "not enough memory" if kind is MemoryError else "somewhere within"
    with pytest.raises(pymeshlab.PyMeshLabException, match=f"Failed to apply .*\n.*{message}"):
        run(ms)
    assert state(ms) == before


@pytest.mark.parametrize("run", [meshlab_sofnn.reconstruct, meshlab_sofnn.estimate_normals])
@pytest.mark.parametrize("kind", [ValueError, StopIteration, KeyboardInterrupt])
def test_what_the_progress_raises_arrives(ms: Any, run: Any, kind: Any, state: Any) -> None:
    error = kind("enough")

    def stop(fraction: float, text: str) -> None:
        raise error

    before = state(ms)
    with pytest.raises(kind) as caught:
        run(ms, progress=stop)
    assert caught.value is error
    assert state(ms) == before


def flat(n: int) -> NDArray[np.float64]:
    return shapes.plane_patch(n).points


@pytest.mark.parametrize("run", [meshlab_sofnn.reconstruct, meshlab_sofnn.estimate_normals])
@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (lambda: None, "requires at least one mesh loaded in the MeshSet"),
        (
            lambda: pymeshlab.Mesh(flat(9), np.array([[0, 1, 2]], dtype=np.int32)),
            "layer 'x' has 1 faces, expected a point cloud",
        ),
        (lambda: pymeshlab.Mesh(flat(3)), "at least 4 finite points, got 3"),
        (lambda: pymeshlab.Mesh(np.ones((50, 3))), "points"),
        (lambda: pymeshlab.Mesh(np.outer(np.arange(50.0), (1, 2, 3))), "points"),
    ],
)
def test_layers_that_are_no_point_cloud(
    run: Callable[..., Any], mesh: Callable[[], Any], message: str, state: Any
) -> None:
    ms = pymeshlab.MeshSet()
    if (made := mesh()) is not None:
        ms.add_mesh(made, "x")
    before = state(ms)
    with pytest.raises(pymeshlab.PyMeshLabException) as caught:
        run(ms)
    assert message in str(caught.value)
    assert state(ms) == before


def test_an_empty_layer(ms: Any, state: Any) -> None:
    ms.apply_filter("set_selection_all")
    ms.apply_filter("meshing_remove_selected_vertices")
    before = state(ms)
    with pytest.raises(pymeshlab.PyMeshLabException, match="layer 'cloud' is empty"):
        meshlab_sofnn.reconstruct(ms)
    assert state(ms) == before


def test_a_matrix_that_flattens_the_layer(ms: Any, state: Any) -> None:
    ms.apply_filter("set_matrix", transformmatrix=np.diag([1.0, 1.0, 0.0, 1.0]), freeze=False)
    before = state(ms)
    with pytest.raises(pymeshlab.PyMeshLabException, match="flattens"):
        meshlab_sofnn.estimate_normals(ms)
    assert state(ms) == before


@pytest.mark.parametrize("run", [meshlab_sofnn.reconstruct, meshlab_sofnn.estimate_normals])
def test_no_room_for_temporary_files(
    ms: Any, run: Callable[..., Any], tmp_path: Path, state: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = state(ms)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    with pytest.raises(pymeshlab.PyMeshLabException, match="temporary file could not be written"):
        run(ms)
    assert state(ms) == before
    with pytest.raises(pymeshlab.PyMeshLabException, match="attribute"):
        ms.current_mesh().vertex_custom_scalar_attribute_array("sofnn_normal_1_x")


def test_the_native_plugin_must_exist(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    missing = tmp_path / "libfilter_sofnn.so"
    with pytest.raises(pymeshlab.PyMeshLabException, match="No such native plugin"):
        meshlab_sofnn.register(missing)
    monkeypatch.setenv("MESHLAB_SOFNN_PLUGIN", str(missing))
    with pytest.raises(pymeshlab.PyMeshLabException, match="No such native plugin"):
        meshlab_sofnn.register()
    monkeypatch.delenv("MESHLAB_SOFNN_PLUGIN")
    with pytest.raises(pymeshlab.PyMeshLabException, match="MESHLAB_SOFNN_PLUGIN"):
        meshlab_sofnn.register(plugin=True)
    assert not hasattr(pymeshlab.MeshSet, RECONSTRUCT)
    missing.write_bytes(b"not a library")
    with pytest.raises(pymeshlab.PyMeshLabException):
        meshlab_sofnn.register(missing)
    assert not hasattr(pymeshlab.MeshSet, RECONSTRUCT)
