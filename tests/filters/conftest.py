"""What the tests of the MeshLab filters share; PyMeshLab is imported by those who ask for it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import native_plugin
import numpy as np
import pytest
import shapes
from numpy.typing import NDArray


@pytest.fixture(scope="module")
def points() -> NDArray[np.float64]:
    """A sphere that is squeezed, so that no two directions are alike."""
    return shapes.sphere(600).points * (1.0, 0.8, 0.6) + (400.0, 30.0, 0.0)


@pytest.fixture(scope="module")
def colors() -> NDArray[np.uint8]:
    return np.random.default_rng(1).integers(0, 256, (600, 4)).astype(np.uint8)


@pytest.fixture
def ms(points: NDArray[np.float64], colors: NDArray[np.uint8]) -> Any:
    """A MeshSet with one coloured point cloud."""
    pymeshlab = pytest.importorskip("pymeshlab")
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(points, v_color_matrix=(colors + 0.5) / 255), "cloud")
    return meshes


@pytest.fixture
def state(tmp_path: Path) -> Callable[[Any], Any]:
    """Return a function that gives everything of a MeshSet that a filter could change."""

    def state(ms: Any) -> Any:
        script = tmp_path / "state.mlx"
        ms.save_filter_script(str(script))
        fields = ("vertex_matrix", "vertex_normal_matrix", "vertex_color_matrix", "face_matrix")
        meshes = [
            (
                mesh.id(),
                mesh.label(),
                mesh.is_visible(),
                mesh.transform_matrix().tobytes(),
                *(getattr(mesh, field)().tobytes() for field in fields),
            )
            for mesh in ms
        ]
        return meshes, ms.current_mesh_id() if meshes else None, script.read_text()

    return state


@pytest.fixture
def unregistered() -> Iterator[None]:
    """Take back, after the test, what it registered."""
    import meshlab_sofnn

    yield
    meshlab_sofnn.unregister()


@pytest.fixture(scope="session")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return native_plugin.folder_of_packages(tmp_path_factory.mktemp("packages"))


@pytest.fixture(scope="session")
def plugin(packages: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The native plugin's file; skips where there is nothing to build it with."""
    kept = os.environ.get("MESHLAB_BUILD")
    return native_plugin.build(packages, Path(kept) if kept else tmp_path_factory.mktemp("plugin"))


@pytest.fixture
def check(packages: Path, plugin: Path, tmp_path: Path) -> Callable[..., str]:
    """Return a function that runs code in a Python that can load the plugin."""
    prelude = Path(__file__).with_name("plugin_prelude.py").read_text()

    def check(code: str, **environment: str) -> str:
        done = native_plugin.run(packages, prelude + code, plugin, tmp_path, **environment)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout + done.stderr

    return check
