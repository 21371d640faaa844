"""Every option of the operators is one of the filters, and means the same."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import o3d_sofnn
from o3d_sofnn import pipeline
from o3d_sofnn.options import OF_NORMALS, Options

pymeshlab = pytest.importorskip("pymeshlab", reason="PyMeshLab is not installed")
import meshlab_sofnn  # noqa: E402 - it needs PyMeshLab
from meshlab_sofnn.parameters import NORMALS, PARAMETERS, RECONSTRUCT  # noqa: E402

PLACE = [400.0, 30.0, 9.0]
LENGTH = pymeshlab.PureValue(0.25)
SAME: list[tuple[str, Any, dict[str, Any]]] = [
    ("max_nn", 30, {"max_nn": 30}),
    ("radius", 0.25, {"radius": LENGTH}),
    ("viewpoint", PLACE, {"orientation": "viewpoint", "viewpos": PLACE}),
    ("towards", [1.0, 0.0, 0.0], {"orientation": "direction", "direction": [1.0, 0.0, 0.0]}),
    ("n_threads", 1, {"n_threads": 1}),
    ("depth", 4, {"depth": 4}),
    ("voxel_size", 0.25, {"voxel_size": LENGTH}),
    ("closed", True, {"closed": "yes"}),
    ("closed", False, {"closed": "no"}),
    ("closed", "auto", {"closed": "auto"}),
    ("trim", 0.5, {"trim": 0.5}),
    ("trim", "auto", {"trim": "auto"}),
    ("target_triangles", 200, {"target_triangles": 200}),
    ("precision", 0.25, {"precision": LENGTH}),
]
"""An option of the operators, a value of it, and what says the same to a filter."""
PLUGIN = Path(__file__).parents[2] / "filters" / "meshlab_plugin" / "filter_sofnn.cpp"


class Seen(Exception):
    """Ends a call when its options are known."""


@pytest.fixture
def seen(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Return what the pipeline is called with, option by option; it computes nothing."""
    calls: list[dict[str, Any]] = []

    def note(points: Any, options: Options, **others: Any) -> None:
        given = {**dataclasses.asdict(options), "normals": others.get("normals")}
        calls.append({k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in given.items()})
        raise Seen

    monkeypatch.setattr(pipeline, "estimate_normals", note)
    monkeypatch.setattr(pipeline, "reconstruct_surface", note)
    return calls


@pytest.mark.parametrize(("option", "value", "params"), SAME)
def test_a_filter_says_the_same_as_the_operator(
    ms: Any, points: Any, seen: Any, option: str, value: Any, params: Any
) -> None:
    pairs: list[tuple[Any, Any]] = [(o3d_sofnn.reconstruct_surface, meshlab_sofnn.reconstruct)]
    if option in OF_NORMALS:
        pairs.append((o3d_sofnn.estimate_normals, meshlab_sofnn.estimate_normals))
    for operator, run in pairs:
        seen.clear()
        with pytest.raises(Seen):
            operator(points, **{option: value})
        with pytest.raises(pymeshlab.PyMeshLabException):
            run(ms, **params)
        assert seen[0] == seen[1]
        assert seen[0][option] == value


def test_use_normals_hands_over_the_normals_of_the_layer(points: Any, seen: Any) -> None:
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(points, v_normals_matrix=normals))
    with pytest.raises(pymeshlab.PyMeshLabException):
        meshlab_sofnn.reconstruct(ms, use_normals=True)
    assert seen[0]["normals"] == normals.tolist()


def test_no_option_is_forgotten() -> None:
    tested = {option for option, _, _ in SAME}
    assert tested == {field.name for field in dataclasses.fields(Options)}
    known = {
        name: {parameter.name for parameter in parameters} - {"use_normals"}
        for name, parameters in PARAMETERS.items()
    }
    spoken = {name for _, _, params in SAME for name in params}
    assert known[RECONSTRUCT] == spoken
    assert known[NORMALS] == {
        name for option, _, params in SAME if option in OF_NORMALS for name in params
    }


def test_the_native_plugin_has_the_same_parameters() -> None:
    found = re.findall(r'addParam\(Rich\w+\("(\w+)"', PLUGIN.read_text(encoding="utf-8"))
    assert found == [parameter.name for parameter in PARAMETERS[RECONSTRUCT]]


def test_another_name_for_auto_makes_the_same_mesh(ms: Any) -> None:
    meshlab_sofnn.reconstruct(ms)
    expected = ms.current_mesh().vertex_matrix()
    ms.set_current_mesh(0)
    meshlab_sofnn.reconstruct(ms, trim="auto")
    np.testing.assert_array_equal(ms.current_mesh().vertex_matrix(), expected)
