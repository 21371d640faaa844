"""Arrays, clouds of trimesh and PyVista: what comes in comes back in kind, and nothing else."""

from __future__ import annotations

import subprocess
import sys
import warnings

import numpy as np
import pytest
from mesh_checks import assert_valid_mesh
from shapes import plane_patch, sphere, torus

import o3d_sofnn
from o3d_sofnn import pipeline

BALL = sphere(1500)


def test_an_array_gives_arrays():
    normals = o3d_sofnn.estimate_normals(BALL.points)
    assert normals.shape == BALL.points.shape
    assert np.einsum("nd,nd->n", normals, BALL.normals).min() > 0.95
    vertices, triangles = o3d_sofnn.reconstruct_surface(BALL.points)
    assert_valid_mesh(vertices, triangles)
    *mesh, details = o3d_sofnn.reconstruct_surface(BALL.points, return_details=True)
    np.testing.assert_array_equal(mesh[0], vertices)
    np.testing.assert_array_equal(details.triangles, triangles)
    again, told = o3d_sofnn.estimate_normals(BALL.points, return_details=True)
    np.testing.assert_array_equal(again, normals)
    np.testing.assert_array_equal(told.normals, normals)


@pytest.mark.parametrize(
    "make",
    [np.ndarray.tolist, lambda x: x.astype(np.float32), lambda x: np.asfortranarray(x)],
    ids=["list", "float32", "fortran"],
)
def test_what_is_as_good_as_an_array(make):
    points = BALL.points.astype(np.float32).astype(np.float64)
    given = make(points)
    expected = pipeline.estimate_normals(points).normals
    np.testing.assert_array_equal(o3d_sofnn.estimate_normals(given), expected)


def test_rows_that_are_not_finite_keep_their_place():
    points = np.insert(BALL.points, 3, np.nan, axis=0)
    with pytest.warns(o3d_sofnn.ReconstructionWarning, match="1 of 1501 points are not finite"):
        normals = o3d_sofnn.estimate_normals(points)
    np.testing.assert_array_equal(normals[3], 0.0)
    np.testing.assert_array_equal(np.delete(normals, 3, axis=0)[::99].shape, (16, 3))


@pytest.mark.parametrize(
    ("given", "match"),
    [
        (BALL.points[:, :2], r"points: expected shape \(n, 3\), got \(1500, 2\)"),
        (BALL.points.ravel(), r"points: expected shape \(n, 3\)"),
        (np.zeros(5, [("x", float), ("y", float), ("z", float)]), "points: expected real numbers"),
        (BALL.points.astype(complex), "points: expected real numbers"),
        ([[1.0, 2.0, 3.0], [1.0, 2.0]], r"points: expected shape \(n, 3\)"),
        (42, r"expected an \(n, 3\) array, .*got int"),
        ("cloud.ply", r"expected an \(n, 3\) array, .*got str"),
        (None, r"expected an \(n, 3\) array, .*got NoneType"),
    ],
)
@pytest.mark.parametrize("operator", ["estimate_normals", "reconstruct_surface"])
def test_what_is_no_cloud_is_refused(operator, given, match):
    with pytest.raises(ValueError, match=match):
        getattr(o3d_sofnn, operator)(given)


def test_doubt_is_a_warning_of_our_class():
    upright = plane_patch(1500).points[:, [2, 0, 1]]
    with pytest.warns(o3d_sofnn.ReconstructionWarning, match="without an outer side") as told:
        o3d_sofnn.estimate_normals(upright)
    assert told[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        o3d_sofnn.estimate_normals(BALL.points)


def test_details_are_a_few_lines():
    *_, details = o3d_sofnn.reconstruct_surface(torus(1500).points, return_details=True)
    for each in (details, details.normals):
        assert 4 <= len(repr(each).splitlines()) < 10
        assert "<table>" in each._repr_html_()
    assert "closed" in repr(details)


def test_trimesh():
    trimesh = pytest.importorskip("trimesh")
    colors = np.tile(np.array([[255, 0, 51, 255]], np.uint8), (len(BALL.points), 1))
    cloud = trimesh.PointCloud(BALL.points, colors=colors)
    assert o3d_sofnn.estimate_normals(cloud) is cloud
    expected = pipeline.estimate_normals(BALL.points).normals
    np.testing.assert_array_equal(cloud.metadata["normals"], expected)
    mesh = o3d_sofnn.reconstruct_surface(cloud)
    assert isinstance(mesh, trimesh.Trimesh)
    assert_valid_mesh(np.array(mesh.vertices), np.array(mesh.faces))
    assert mesh.is_watertight
    np.testing.assert_array_equal(np.unique(mesh.visual.vertex_colors, axis=0), colors[:1])
    mesh, details = o3d_sofnn.reconstruct_surface(cloud, use_normals=True, return_details=True)
    assert details.normals.evidence.kind == "normals"


def test_pyvista():
    pyvista = pytest.importorskip("pyvista")
    cloud = pyvista.PolyData(BALL.points)
    cloud.point_data["height"] = BALL.points[:, 2]
    assert o3d_sofnn.estimate_normals(cloud) is cloud
    expected = pipeline.estimate_normals(cloud.points.astype(np.float64)).normals
    np.testing.assert_array_equal(cloud.point_data["Normals"], expected)
    mesh = o3d_sofnn.reconstruct_surface(cloud)
    assert isinstance(mesh, pyvista.PolyData)
    assert_valid_mesh(np.array(mesh.points, np.float64), mesh.faces.reshape(-1, 4)[:, 1:])
    assert np.abs(mesh.point_data["height"] - mesh.points[:, 2]).max() < 0.15


def test_arrays_and_files_need_no_open3d(tmp_path):
    np.save(tmp_path / "ball.npy", BALL.points)
    code = """
import sys
sys.modules["open3d"] = None
import numpy as np, o3d_sofnn
from o3d_sofnn.cli import main
points = np.load("ball.npy")
assert o3d_sofnn.estimate_normals(points).shape == points.shape
assert main.main(["normals", "ball.npy", "out.ply"]) == 0
assert main.main(["reconstruct", "out.ply", "mesh.ply"]) == 0
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=120, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert (tmp_path / "mesh.ply").stat().st_size > 10_000
