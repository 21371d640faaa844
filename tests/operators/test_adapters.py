"""Both of Open3D's families in, the same family out, nothing of the user's lost."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import shapes
from mesh_checks import assert_valid_mesh

import o3d_sofnn
from o3d_sofnn import adapters
from o3d_sofnn.files import point_files

o3d = pytest.importorskip("open3d")

N = 1500


@pytest.fixture(scope="module")
def shape():
    return shapes.sphere(N)


@pytest.fixture
def rich_cloud(shape):
    """Return a tensor cloud with attributes of several number types."""
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(shape.points))
    cloud.point["colors"] = o3d.core.Tensor(np.tile([[255, 128, 0]], (N, 1)).astype(np.uint8))
    height = shape.points[:, 2:].astype(np.float32)
    cloud.point["height"] = o3d.core.Tensor(height)
    cloud.point["side"] = o3d.core.Tensor((height > 0).astype(np.int64))
    return cloud


def test_normals_are_written_in_place_and_returned(shape, family, make_cloud, normals_of):
    cloud = make_cloud(shape.points, family)
    returned = o3d_sofnn.estimate_normals(cloud)
    assert returned is cloud
    normals = normals_of(cloud)
    assert normals.shape == (N, 3)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert (np.einsum("ij,ij->i", normals, shape.normals) > 0.9).all()
    assert np.array_equal(adapters.read_cloud(cloud).points, shape.points)


def test_both_families_give_the_same_normals(shape, make_cloud, normals_of):
    legacy, tensor = make_cloud(shape.points, "legacy"), make_cloud(shape.points, "tensor")
    o3d_sofnn.estimate_normals(legacy)
    o3d_sofnn.estimate_normals(tensor)
    assert np.array_equal(normals_of(legacy), normals_of(tensor))


def test_both_families_give_the_same_mesh(shape, make_cloud):
    meshes = [o3d_sofnn.reconstruct_surface(make_cloud(shape.points, f)) for f in FAMILIES]
    assert isinstance(meshes[0], o3d.geometry.TriangleMesh)
    assert isinstance(meshes[1], o3d.t.geometry.TriangleMesh)
    (first, triangles), (second, other) = map(adapters.read_mesh, meshes)
    assert np.array_equal(first.points, second.points)
    assert np.array_equal(triangles, other)
    assert np.array_equal(first.normals, second.normals)


FAMILIES = ("legacy", "tensor")


def test_the_mesh_is_valid_and_carries_normals_and_colors(shape, family, make_cloud):
    # One colour per half: blending keeps it on each pole.
    shares = np.where(shape.points[:, 2:] > 0, [[1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    mesh = o3d_sofnn.reconstruct_surface(make_cloud(shape.points, family, colors=shares))
    assert_valid_mesh(mesh, components=1)
    vertices, _ = adapters.read_mesh(mesh)
    assert np.allclose(np.linalg.norm(vertices.normals, axis=1), 1.0)
    assert (np.einsum("ij,ij->i", vertices.normals, vertices.points) > 0).all()
    colors = vertices.attributes["colors"]
    assert colors.min() >= 0.0
    assert colors.max() <= 1.0
    assert np.allclose(colors[vertices.points[:, 2] > 0.6], [1.0, 0.0, 0.0], atol=1e-6)
    assert np.allclose(colors[vertices.points[:, 2] < -0.6], [0.0, 0.0, 1.0], atol=1e-6)


def test_a_cloud_without_colors_gives_a_mesh_without(shape, make_cloud):
    assert not o3d_sofnn.reconstruct_surface(make_cloud(shape.points)).has_vertex_colors()


def test_attributes_of_tensor_clouds_survive(rich_cloud):
    before = {name: rich_cloud.point[name].numpy().copy() for name in rich_cloud.point}
    o3d_sofnn.estimate_normals(rich_cloud)
    assert set(rich_cloud.point) == {*before, "normals"}
    for name, values in before.items():
        assert np.array_equal(rich_cloud.point[name].numpy(), values), name


def test_attributes_of_tensor_clouds_reach_the_mesh(rich_cloud):
    mesh = o3d_sofnn.reconstruct_surface(rich_cloud)
    height = mesh.vertex["positions"].numpy()[:, 2]
    assert np.allclose(mesh.vertex["colors"].numpy(), np.array([255, 128, 0]) / 255)
    assert mesh.vertex["height"].dtype == o3d.core.float32
    assert np.abs(mesh.vertex["height"].numpy()[:, 0] - height).max() < 0.3
    assert mesh.vertex["side"].dtype == o3d.core.int64
    clear = np.abs(height) > 0.4
    assert np.array_equal(mesh.vertex["side"].numpy()[clear, 0], height[clear] > 0)


def test_reconstruction_does_not_touch_the_cloud(shape, family, make_cloud):
    cloud = make_cloud(shape.points, family, normals=-shape.normals)
    o3d_sofnn.reconstruct_surface(cloud)
    arrays = adapters.read_cloud(cloud)
    assert np.array_equal(arrays.points, shape.points)
    assert np.array_equal(arrays.normals, -shape.normals)


def test_own_normals_are_ignored_unless_asked_for(shape, make_cloud):
    inward = make_cloud(shape.points, normals=-shape.normals)
    assert o3d_sofnn.reconstruct_surface(inward).get_volume() > 0
    outward = make_cloud(shape.points, normals=shape.normals)
    mesh = o3d_sofnn.reconstruct_surface(outward, use_normals=True)
    assert_valid_mesh(mesh, components=1)
    assert mesh.get_volume() == pytest.approx(4 / 3 * np.pi, rel=0.05)


def test_search_params_are_understood():
    geometry = o3d.geometry
    assert adapters.read_search_param(None) == (None, None)
    assert adapters.read_search_param(geometry.KDTreeSearchParamKNN(20)) == (20, None)
    assert adapters.read_search_param(geometry.KDTreeSearchParamRadius(0.5)) == (None, 0.5)
    assert adapters.read_search_param(geometry.KDTreeSearchParamHybrid(0.5, 20)) == (20, 0.5)


@pytest.mark.parametrize(
    "search_param",
    [
        o3d.geometry.KDTreeSearchParamKNN(40),
        o3d.geometry.KDTreeSearchParamRadius(0.3),
        o3d.geometry.KDTreeSearchParamHybrid(0.3, 40),
    ],
    ids=["knn", "radius", "hybrid"],
)
def test_search_params_are_used(shape, make_cloud, normals_of, search_param):
    cloud = o3d_sofnn.estimate_normals(make_cloud(shape.points), search_param)
    assert (np.einsum("ij,ij->i", normals_of(cloud), shape.normals) > 0.9).all()


def test_details_have_one_row_per_point(shape, make_cloud):
    cloud = make_cloud(shape.points)
    returned, details = o3d_sofnn.estimate_normals(cloud, return_details=True)
    assert returned is cloud
    assert isinstance(details, o3d_sofnn.NormalDetails)
    assert np.array_equal(details.normals, np.asarray(cloud.normals))
    for values in (details.confidence, details.outliers, details.noise):
        assert values.shape == (N,)
    assert details.outliers.dtype == bool
    assert 0.0 <= details.confidence.min() <= details.confidence.max() <= 1.0
    assert 0 < len(details.rules.centers) < N
    assert all(seconds >= 0 for seconds in details.seconds.values())


def test_details_of_the_mesh(shape, make_cloud):
    mesh, details = o3d_sofnn.reconstruct_surface(make_cloud(shape.points), return_details=True)
    assert isinstance(details, o3d_sofnn.SurfaceDetails)
    assert np.array_equal(details.vertices, np.asarray(mesh.vertices))
    assert details.confidence.shape == (len(mesh.vertices),)
    assert details.source_weights.shape == (len(mesh.vertices), N)
    assert np.allclose(details.source_weights.sum(axis=1), 1.0)
    assert details.watertight
    assert details.voxel_size > 0


@pytest.mark.parametrize("operator", ["estimate_normals", "reconstruct_surface"])
def test_any_number_of_threads_gives_the_same(shape, make_cloud, operator):
    results = []
    for n_threads in (1, 2, -1):
        result = getattr(o3d_sofnn, operator)(make_cloud(shape.points), n_threads=n_threads)
        is_mesh = operator == "reconstruct_surface"
        results.append(np.asarray(result.vertices if is_mesh else result.normals))
    assert np.array_equal(results[0], results[1])
    assert np.array_equal(results[0], results[2])


def test_progress_rises_from_0_to_1(shape, make_cloud):
    reports = []
    o3d_sofnn.reconstruct_surface(
        make_cloud(shape.points), print_progress=lambda *report: reports.append(report)
    )
    fractions = [fraction for fraction, _ in reports]
    assert fractions == sorted(fractions)
    assert fractions[0] >= 0.0
    assert fractions[-1] == 1.0
    assert all(text for _, text in reports)


def test_a_bar_is_drawn_on_request(shape, make_cloud, capfd, monkeypatch):
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    o3d_sofnn.estimate_normals(make_cloud(shape.points))
    assert capfd.readouterr() == ("", "")
    o3d_sofnn.estimate_normals(make_cloud(shape.points), print_progress=True)
    out, err = capfd.readouterr()
    assert out == ""
    assert "100 %" in err
    assert err.endswith("\n")


@pytest.mark.parametrize(
    ("kind", "full"),
    [(np.uint8, 255), (np.uint16, 65535), (np.int32, 255), (np.float32, 1), (np.float64, 1)],
)
def test_colors_of_the_mesh_are_those_of_the_cloud(shape, make_cloud, tmp_path, kind, full):
    wanted = np.array([200.0, 100.0, 30.0]) / 255
    # Half of the points a little darker, half of them a little brighter.
    shares = wanted + 0.1 * np.sign(shape.points[:, 2:])
    colors = (shares * full).round(0 if full > 1 else 9).astype(kind)
    mesh = o3d_sofnn.reconstruct_surface(make_cloud(shape.points, "tensor", colors=colors))
    o3d.t.io.write_triangle_mesh(str(tmp_path / "theirs.ply"), mesh)
    point_files.write_triangle_mesh(tmp_path / "ours.ply", mesh)
    for found in (
        mesh.to_legacy(),
        o3d.io.read_triangle_mesh(str(tmp_path / "theirs.ply")),
        o3d.io.read_triangle_mesh(str(tmp_path / "ours.ply")),
    ):
        assert np.abs(np.asarray(found.vertex_colors).mean(axis=0) - wanted).max() < 1 / 255


def test_viewpoint_and_direction_decide_the_side(make_cloud, normals_of):
    patch = shapes.plane_patch(N)
    for sign in (1.0, -1.0):
        for side in ({"viewpoint": (0.0, 0.0, 3.0 * sign)}, {"towards": (0.0, 0.0, sign)}):
            cloud = o3d_sofnn.estimate_normals(make_cloud(patch.points), **side)
            assert np.allclose(normals_of(cloud), [0.0, 0.0, sign], atol=1e-3)


def test_a_viewpoint_for_each_point_keeps_the_order(make_cloud, normals_of, caplog):
    patch = shapes.plane_patch(N)
    points = np.concatenate([patch.points, patch.moved((0.0, 0.0, 5.0)).points, [[np.nan] * 3]])
    viewpoint = np.repeat([[0.0, 0.0, -3.0], [0.0, 0.0, 8.0], [0.0, 0.0, 0.0]], [N, N, 1], axis=0)
    cloud = o3d_sofnn.estimate_normals(make_cloud(points), viewpoint=viewpoint)
    assert np.allclose(normals_of(cloud)[:N], [0.0, 0.0, -1.0], atol=1e-3)
    assert np.allclose(normals_of(cloud)[N:-1], [0.0, 0.0, 1.0], atol=1e-3)
    o3d_sofnn.estimate_normals(make_cloud(patch.points[:, [2, 0, 1]]))
    assert "without an outer side" in caplog.text


def test_without_open3d_the_message_says_what_to_type(monkeypatch):
    cloud = type("PointCloud", (), {"__module__": "open3d.geometry"})()
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(ImportError, match=r"pip install 'o3d_sofnn\[open3d\]'"):
        o3d_sofnn.estimate_normals(cloud)
    with pytest.raises(ImportError, match=r"pip install 'o3d_sofnn\[open3d\]'"):
        o3d_sofnn.reconstruct_surface(cloud)
