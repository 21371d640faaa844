"""Helpers of the tests (shapes, mesh_checks) can be imported, Open3D clouds are made here."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

# pytest's importlib mode, which keeps the source tree off the path, does not add their folder.
sys.path.insert(0, str(Path(__file__).parent / "helpers"))


@pytest.fixture(params=["legacy", "tensor"])
def family(request: pytest.FixtureRequest) -> str:
    """Both of Open3D's families of geometry."""
    return request.param


@pytest.fixture
def make_cloud() -> Callable[..., Any]:
    """Return a maker of Open3D clouds of either family from arrays."""
    o3d = pytest.importorskip("open3d")

    def make(
        points: Any, family: str = "legacy", *, colors: Any = None, normals: Any = None
    ) -> Any:
        points = np.asarray(points)
        if family == "tensor":
            cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(np.ascontiguousarray(points)))
            for name, values in (("colors", colors), ("normals", normals)):
                if values is not None:
                    cloud.point[name] = o3d.core.Tensor(np.ascontiguousarray(values))
            return cloud
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points.astype(np.float64)))
        if colors is not None:
            cloud.colors = o3d.utility.Vector3dVector(colors)
        if normals is not None:
            cloud.normals = o3d.utility.Vector3dVector(normals)
        return cloud

    return make


@pytest.fixture
def normals_of() -> Callable[[Any], Any]:
    """Return a reader of a cloud's normals as an array."""
    from o3d_sofnn import adapters

    return lambda pcd: adapters.read_cloud(pcd).normals
