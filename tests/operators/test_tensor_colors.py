"""Colours of 8 bits in tensor clouds, and of meshes made of them, through Open3D's own writers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes
from scipy.spatial import cKDTree

import o3d_sofnn
from o3d_sofnn.files import point_files

o3d = pytest.importorskip("open3d")

LEVELS = np.random.default_rng(0).integers(0, 256, (900, 3)).astype(np.uint8)


@pytest.fixture(scope="module")
def cloud() -> Any:
    points = shapes.torus(len(LEVELS)).points
    pcd = o3d.t.geometry.PointCloud(o3d.core.Tensor(points.astype(np.float32)))
    pcd.point["colors"] = o3d.core.Tensor(LEVELS)
    return o3d_sofnn.estimate_normals(pcd)


@pytest.mark.parametrize("ending", ["ply", "pcd", "pts"])
def test_clouds(cloud: Any, tmp_path: Path, ending: str) -> None:
    path = str(tmp_path / f"cloud.{ending}")
    assert cloud.point["colors"].dtype == o3d.core.uint8
    assert o3d.t.io.write_point_cloud(path, cloud)
    found = o3d.t.io.read_point_cloud(path).point["colors"]
    np.testing.assert_array_equal(found.numpy(), LEVELS)
    legacy = np.asarray(o3d.io.read_point_cloud(path).colors)
    np.testing.assert_allclose(255.0 * legacy, LEVELS, atol=1e-4)
    np.testing.assert_array_equal(point_files.read_points(path).attributes["colors"], LEVELS)


def test_clouds_that_we_read(cloud: Any, tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours.ply", str(tmp_path / "theirs.ply")
    point_files.write_point_cloud(ours, cloud)
    read = o3d_sofnn.estimate_normals(point_files.read_point_cloud(ours))
    assert o3d.t.io.write_point_cloud(theirs, read)
    found = o3d.t.io.read_point_cloud(theirs).point["colors"]
    np.testing.assert_array_equal(found.numpy(), LEVELS)


@pytest.mark.parametrize("ending", ["ply", "obj", "glb", "off"])
def test_meshes(cloud: Any, tmp_path: Path, ending: str) -> None:
    mesh, details = o3d_sofnn.reconstruct_surface(cloud, return_details=True)
    assert mesh.vertex["colors"].dtype == o3d.core.float32
    path = str(tmp_path / f"mesh.{ending}")
    assert o3d.t.io.write_triangle_mesh(path, mesh)
    found = o3d.io.read_triangle_mesh(path)
    # Some come back in another order: the vertices say which is which.
    away, order = cKDTree(np.asarray(found.vertices)).query(details.vertices)
    assert away.max() < 1e-4
    shares = mesh.vertex["colors"].numpy()
    assert 0.2 < shares.mean() < 0.8
    stored = np.asarray(found.vertex_colors)[order]
    np.testing.assert_allclose(stored, shares, atol=0.51 / 255)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize("ending", ["ply", "obj", "glb"])
def test_meshes_of_clouds_whose_colours_are_fractions(
    cloud: Any, tmp_path: Path, ending: str, kind: type
) -> None:
    fractions = cloud.clone()
    fractions.point["colors"] = o3d.core.Tensor((LEVELS / 255).astype(kind))
    mesh = o3d_sofnn.reconstruct_surface(fractions)
    assert mesh.vertex["colors"].numpy().dtype == kind
    path = str(tmp_path / f"mesh.{ending}")
    assert o3d.t.io.write_triangle_mesh(path, mesh)
    found = o3d.t.io.read_triangle_mesh(path)
    away, order = cKDTree(found.vertex["positions"].numpy()).query(mesh.vertex["positions"].numpy())
    assert away.max() < 1e-4
    stored = found.vertex["colors"].numpy()[order]
    np.testing.assert_allclose(stored, mesh.vertex["colors"].numpy(), atol=0.51 / 255)
