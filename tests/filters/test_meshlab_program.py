"""The native MeshLab plugin where no Python has set an engine: it runs the program o3d-sofnn."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest


def program(folder: Path, text: str) -> str:
    path = folder / "o3d-sofnn"
    path.write_text("#!/bin/sh\n" + text)
    path.chmod(0o755)
    return str(path)


def test_the_program_runs_where_no_python_has_set_an_engine(
    check: Any, packages: Path, tmp_path: Path
) -> None:
    pytest.importorskip("open3d")
    command = f"PYTHONPATH='{packages}' exec '{sys.executable}' -m o3d_sofnn \"$@\"\n"
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
