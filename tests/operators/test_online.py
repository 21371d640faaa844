"""Reconstruction of sweeps, in any order, however often they come."""

import numpy as np
import open3d as o3d
import pytest
from mesh_checks import assert_valid_mesh
from scipy.spatial import cKDTree
from shapes import sphere, torus

import o3d_sofnn
from o3d_sofnn import OnlineReconstruction, reconstruct_surface
from o3d_sofnn.operators.online import turned

SHAPE = torus(6000)
SPACING = np.sqrt(4.0 * np.pi**2 * 0.4 / 6000)
SWEEPS = np.array_split(np.argsort(SHAPE.points[:, 0], kind="stable"), 4)


def model_of(order=range(4), **options):
    model = OnlineReconstruction(**options)
    for i in order:
        model.add(SHAPE.points[SWEEPS[i]])
    return model


def distance(one, other):
    """Mean distance between the vertices of two meshes, both ways."""
    a, b = cKDTree(one).query(other)[0], cKDTree(other).query(one)[0]
    return 0.5 * (a.mean() + b.mean())


def test_sweeps_become_the_mesh_of_all_points():
    vertices, triangles = model_of().mesh()
    assert_valid_mesh(vertices, triangles)
    rim = np.hypot(vertices[:, 0], vertices[:, 1]) - 1.0
    off = np.abs(np.hypot(rim, vertices[:, 2]) - 0.4)
    assert off.mean() < 0.05 * SPACING
    whole, _ = reconstruct_surface(SHAPE.points)
    assert distance(vertices, whole) < 0.5 * SPACING  # vertices of both lie between each other


def test_the_order_of_sweeps_does_not_matter():
    one, other = model_of(range(4)), model_of([0, 3, 1, 2])
    np.testing.assert_allclose(one.mesh()[0], other.mesh()[0], atol=1e-9)


def test_what_comes_again_adds_nothing():
    model = model_of()
    cells, before = len(model), model.mesh()
    for _ in range(9):
        for rows in SWEEPS:
            model.add(SHAPE.points[rows])
    assert len(model) == cells
    again = model.mesh()
    assert distance(before[0], again[0]) < 1e-6
    assert len(again[1]) == pytest.approx(len(before[1]), rel=0.01)


def test_more_points_than_cells_do_not_grow_it():
    model = OnlineReconstruction()
    model.add(sphere(1000).points)
    for seed in range(1, 30):
        model.add(sphere(1000, seed=seed).points)
    cells = len(model)
    for seed in range(30, 60):
        model.add(sphere(1000, seed=seed).points)
    assert len(model) < 1.35 * cells
    assert "60000 points" in repr(model)


def test_a_box_is_removed():
    model = model_of()
    box = o3d.geometry.AxisAlignedBoundingBox([0.0, -2.0, -2.0], [2.0, 2.0, 2.0])
    assert model.remove([[5.0, 5.0, 5.0], [6.0, 6.0, 6.0]]) == 0
    assert model.remove(box) > 1000
    vertices, _ = model.mesh()
    assert vertices[:, 0].max() < 4.0 * SPACING


def test_normals_of_any_points_come_from_all_sweeps():
    found = model_of().estimate_normals(SHAPE.points)
    cosine = np.einsum("nd,nd->n", found, SHAPE.normals)
    assert np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).mean() < 4.0
    with_gap = np.vstack([SHAPE.points[:5], np.full((1, 3), np.nan)])
    assert not model_of().estimate_normals(with_gap)[-1].any()


def test_the_scanner_decides_the_sides():
    inside = OnlineReconstruction()
    for seed in range(2):
        inside.add(sphere(1500, seed=seed).points, viewpoint=np.zeros(3))
    normals = inside.estimate_normals(sphere(1500).points)
    assert (np.einsum("nd,nd->n", normals, sphere(1500).points) < 0.0).mean() > 0.99
    part = OnlineReconstruction(towards=(0.0, 0.0, -1.0))
    part.add(sphere(1500).points[sphere(1500).points[:, 2] > 0.3])
    vertices, triangles = part.mesh()
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] < 0.0).mean() > 0.9


def test_turned_components_are_told():
    *_, details = model_of().mesh(return_details=True)
    rules = details.normals.rules
    assert len(turned(rules, rules)) == 0
    middles = turned(rules.facing(-rules.normals), rules)
    assert middles.shape == (1, 3)
    assert np.abs(middles).max() < 0.1


@pytest.mark.parametrize("tensor", [False, True])
def test_clouds_of_open3d_become_its_meshes(tensor):
    model = OnlineReconstruction(depth=4)
    for rows in SWEEPS:
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(SHAPE.points[rows]))
        model.add(o3d.t.geometry.PointCloud.from_legacy(cloud) if tensor else cloud)
    kind = o3d.t.geometry.TriangleMesh if tensor else o3d.geometry.TriangleMesh
    assert isinstance(model.mesh(), kind)


def test_saved_and_loaded_it_goes_on(tmp_path):
    model = model_of([0, 1], closed=True, n_threads=1)
    model.save(tmp_path / "model.npz")
    loaded = OnlineReconstruction.load(tmp_path / "model.npz")
    for each in (model, loaded):
        for i in (2, 3):
            each.add(SHAPE.points[SWEEPS[i]])
    one, other = model.mesh(), loaded.mesh()
    np.testing.assert_array_equal(one[0], other[0])
    np.testing.assert_array_equal(one[1], other[1])
    assert repr(model) == repr(loaded)
    OnlineReconstruction().save(tmp_path / "empty.npz")
    assert len(OnlineReconstruction.load(tmp_path / "empty.npz")) == 0


@pytest.mark.parametrize("content", [b"", b"PK", b"something else"])
def test_other_files_are_refused(tmp_path, content):
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"a\.npz: expected a file of OnlineReconstruction\.save"):
        OnlineReconstruction.load(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", points=np.zeros((3, 3)))
    with pytest.raises(ValueError, match=r"b\.npz: expected"):
        OnlineReconstruction.load(tmp_path / "b.npz")


def test_bad_calls_are_said():
    with pytest.raises(TypeError, match="viewpoint: expected one of"):
        OnlineReconstruction(viewpoint=(0, 0, 0))
    with pytest.raises(ValueError, match="depth"):
        OnlineReconstruction(depth=99)
    model = OnlineReconstruction()
    with pytest.raises(ValueError, match="add a cloud first"):
        model.mesh()
    with pytest.raises(ValueError, match="pcd"):
        model.add(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="viewpoint"):
        model.add(SHAPE.points, viewpoint=(1.0, 2.0))
    for box in (3, [[0, 0, 0]], [[1, 1, 1], [0, 0, 0]], "box"):
        with pytest.raises(ValueError, match="box: expected"):
            model.remove(box)
    assert "OnlineReconstruction" in o3d_sofnn.__all__
