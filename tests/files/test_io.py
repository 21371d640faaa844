"""Files: formats keep what they can hold, and appear whole or not at all."""

from __future__ import annotations

import errno
import os
import stat

import numpy as np
import pytest

from o3d_sofnn import adapters
from o3d_sofnn.files import point_files

UTM = np.array([5e5, 4.9e6, 100.0])


@pytest.fixture
def cloud():
    pytest.importorskip("open3d")
    rng = np.random.default_rng(0)
    n = 200
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    attributes = {
        "colors": rng.integers(0, 256, (n, 3)).astype(np.uint8),
        "intensity": rng.random((n, 1)).astype(np.float32),
        "label": np.arange(n, dtype=np.int32)[:, np.newaxis],
    }
    points = UTM + rng.uniform(0.0, 30.0, (n, 3))
    return adapters.make_cloud(adapters.CloudArrays(points, normals, attributes))


@pytest.fixture
def mesh():
    o3d = pytest.importorskip("open3d")
    mesh = o3d.geometry.TriangleMesh.create_torus()
    mesh.compute_vertex_normals()
    mesh.translate(UTM)
    levels = np.random.default_rng(0).integers(0, 256, (len(mesh.vertices), 3))
    mesh.vertex_colors = o3d.utility.Vector3dVector(levels / 255.0)
    return mesh


def o3d_tensor(values):
    return pytest.importorskip("open3d").core.Tensor(values)


def las_file(path, points, **dimensions):
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=2, version="1.2")
    header.offsets, header.scales = UTM, [0.001] * 3
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    for name, values in dimensions.items():
        setattr(data, name, values)
    data.write(path)


@pytest.mark.parametrize("ending", [".ply", ".npz", ".xyzn"])
def test_clouds_keep_every_digit(tmp_path, cloud, ending):
    point_files.write_point_cloud(tmp_path / f"cloud{ending}", cloud)
    back = point_files.read_point_cloud(tmp_path / f"cloud{ending}")
    assert np.array_equal(back.point.positions.numpy(), cloud.point.positions.numpy())
    assert np.array_equal(back.point.normals.numpy(), cloud.point.normals.numpy())


@pytest.mark.parametrize("ending", [".ply", ".npz"])
def test_attributes_survive(tmp_path, cloud, ending):
    point_files.write_point_cloud(tmp_path / f"cloud{ending}", cloud)
    back = point_files.read_point_cloud(tmp_path / f"cloud{ending}")
    for name in ("colors", "intensity", "label"):
        assert back.point[name].dtype == cloud.point[name].dtype
        assert np.array_equal(back.point[name].numpy(), cloud.point[name].numpy())


def test_attributes_that_ply_has_no_type_for(tmp_path, cloud):
    n = len(cloud.point.positions)
    stored = adapters.read_cloud(cloud)
    stored.attributes["far id"] = np.arange(n)[:, np.newaxis] + 2**40
    stored.attributes["seen"] = (np.arange(n) % 2 == 0)[:, np.newaxis]
    stored.attributes["uv"] = np.random.default_rng(0).random((n, 2))
    point_files.write_point_cloud(tmp_path / "cloud.ply", adapters.make_cloud(stored))
    back = point_files.read_point_cloud(tmp_path / "cloud.ply").point
    assert np.array_equal(back["far_id"].numpy(), stored.attributes["far id"])
    assert np.array_equal(back["seen"].numpy(), stored.attributes["seen"])
    assert np.array_equal(back["uv_1"].numpy()[:, 0], stored.attributes["uv"][:, 1])


def test_attributes_with_names_that_mean_something_to_numpy(tmp_path, cloud):
    stored = adapters.read_cloud(cloud)
    for i, name in enumerate(("file", "allow_pickle", "a/b")):
        stored.attributes[name] = np.full((len(stored.points), 1), i)
    point_files.write_point_cloud(tmp_path / "cloud.npz", adapters.make_cloud(stored))
    with np.load(tmp_path / "cloud.npz") as archive:
        assert set(archive.files) == {"positions", "normals", *stored.attributes}
        assert archive["allow_pickle"].shape == (len(stored.points), 1)
    back = point_files.read_points(tmp_path / "cloud.npz")
    assert back.notes == ()
    assert back.attributes.keys() == stored.attributes.keys()
    for name, values in stored.attributes.items():
        assert np.array_equal(back.attributes[name], values)


@pytest.mark.parametrize("ending", [".ply", ".npz", ".xyz", ".pcd"])
def test_values_that_are_not_one_per_point_are_said(tmp_path, cloud, ending, caplog):
    stored = adapters.read_cloud(cloud)
    stored.attributes.clear()
    wrong = adapters.make_cloud(stored)
    for name, values in (("scale", np.array(3.0)), ("some", np.zeros((4, 1)))):
        wrong.point[name] = o3d_tensor(values)
    point_files.write_point_cloud(tmp_path / f"cloud{ending}", wrong)
    assert "not kept, as not one per point: scale some" in caplog.text
    back = point_files.read_points(tmp_path / f"cloud{ending}")
    assert len(back.points) == len(stored.points)
    assert back.notes == ()
    assert back.attributes == {}


def test_numbers_too_large_for_ply_are_said(tmp_path, cloud, caplog):
    stored = adapters.read_cloud(cloud)
    stored.attributes["id"] = np.full((len(stored.points), 1), 2**60 + 1)
    point_files.write_point_cloud(tmp_path / "cloud.ply", adapters.make_cloud(stored))
    assert "rounded to double precision: id" in caplog.text


@pytest.mark.parametrize(
    ("ending", "lost"),
    [
        (".ply", None),
        (".npz", None),
        (".pcd", "intensity label"),
        (".xyz", "colors intensity label"),
        (".las", "intensity label"),
    ],
)
def test_what_a_format_has_no_room_for_is_said(tmp_path, cloud, ending, lost, caplog):
    pytest.importorskip("laspy")
    point_files.write_point_cloud(tmp_path / f"cloud{ending}", cloud)
    assert (f"not kept: {lost};" in caplog.text) == (lost is not None)
    assert ("not kept" in caplog.text) == (lost is not None)


@pytest.mark.parametrize(
    ("ending", "lost"), [(".ply", None), (".obj", None), (".off", None), (".stl", "colors")]
)
def test_what_a_mesh_format_has_no_room_for_is_said(tmp_path, mesh, ending, lost, caplog):
    point_files.write_triangle_mesh(tmp_path / f"mesh{ending}", mesh)
    assert (f"not kept: {lost};" in caplog.text) == (lost is not None)
    assert ("not kept" in caplog.text) == (lost is not None)


def test_open3d_reads_the_ply_as_it_is(tmp_path, cloud):
    o3d = pytest.importorskip("open3d")
    point_files.write_point_cloud(tmp_path / "cloud.ply", cloud)
    legacy = o3d.io.read_point_cloud(str(tmp_path / "cloud.ply"))
    assert np.array_equal(np.asarray(legacy.points), cloud.point.positions.numpy())
    assert np.array_equal(np.asarray(legacy.normals), cloud.point.normals.numpy())
    assert np.allclose(np.asarray(legacy.colors) * 255, cloud.point.colors.numpy())


def test_pcd_says_that_it_rounds(tmp_path, cloud, caplog):
    point_files.write_point_cloud(tmp_path / "cloud.pcd", cloud)
    assert "single precision" in caplog.text
    back = point_files.read_point_cloud(tmp_path / "cloud.pcd")
    single = cloud.point.positions.numpy().astype(np.float32)
    assert np.array_equal(back.point.positions.numpy(), single)
    assert np.array_equal(back.point.colors.numpy(), cloud.point.colors.numpy())


def test_a_new_las_is_finer_than_a_micrometre(tmp_path, cloud):
    pytest.importorskip("laspy")
    point_files.write_point_cloud(tmp_path / "cloud.laz", cloud)
    back = point_files.read_point_cloud(tmp_path / "cloud.laz")
    difference = back.point.positions.numpy() - cloud.point.positions.numpy()
    assert np.abs(difference).max() < 1e-6
    assert np.array_equal(back.point.colors.numpy(), cloud.point.colors.numpy().astype(int) * 257)


def test_las_refuses_what_it_cannot_hold(tmp_path, cloud):
    pytest.importorskip("laspy")
    positions = cloud.point.positions.numpy().copy()
    positions[3, 1] = np.nan
    broken = adapters.make_cloud(adapters.CloudArrays(positions))
    with pytest.raises(ValueError, match="finite"):
        point_files.write_point_cloud(tmp_path / "cloud.las", broken)
    las_file(tmp_path / "other.las", UTM + np.zeros((7, 3)))
    with pytest.raises(ValueError, match="7 points"):
        point_files.write_point_cloud(
            tmp_path / "cloud.las", cloud, template=tmp_path / "other.las"
        )
    assert [path.name for path in tmp_path.iterdir()] == ["other.las"]


@pytest.mark.parametrize("ending", [".ply", ".obj", ".off", ".stl"])
def test_open3d_reads_the_meshes(tmp_path, mesh, ending):
    o3d = pytest.importorskip("open3d")
    mesh.translate(-UTM)
    point_files.write_triangle_mesh(tmp_path / f"mesh{ending}", mesh)
    back = o3d.io.read_triangle_mesh(str(tmp_path / f"mesh{ending}"))
    assert len(back.triangles) == len(mesh.triangles)
    corners = [np.asarray(m.vertices)[np.asarray(m.triangles)] for m in (back, mesh)]
    assert np.allclose(*corners, atol=1e-6)
    assert back.get_surface_area() == pytest.approx(mesh.get_surface_area(), rel=1e-5)
    assert back.has_vertex_colors() == (ending != ".stl")


def test_meshes_keep_every_digit(tmp_path, mesh):
    o3d = pytest.importorskip("open3d")
    vertices = np.asarray(mesh.vertices)
    point_files.write_triangle_mesh(tmp_path / "mesh.ply", mesh)
    back = o3d.io.read_triangle_mesh(str(tmp_path / "mesh.ply"))
    assert np.array_equal(np.asarray(back.vertices), vertices)
    assert np.array_equal(np.asarray(back.triangles), np.asarray(mesh.triangles))
    assert np.array_equal(np.asarray(back.vertex_normals), np.asarray(mesh.vertex_normals))
    assert np.allclose(np.asarray(back.vertex_colors), np.asarray(mesh.vertex_colors))
    point_files.write_triangle_mesh(tmp_path / "mesh.obj", mesh)
    lines = (tmp_path / "mesh.obj").read_text().splitlines()
    numbers = [line.split()[1:4] for line in lines if line.startswith("v ")]
    assert np.array_equal(np.array(numbers, dtype=float), vertices)


def test_text_keeps_double_precision_on_reading(tmp_path):
    pytest.importorskip("open3d")
    (tmp_path / "cloud.xyz").write_text("500000.125 4900000.0625 1.5\n" * 3)
    cloud = point_files.read_point_cloud(tmp_path / "cloud.xyz")
    assert cloud.point.positions.numpy()[2].tolist() == [500000.125, 4900000.0625, 1.5]


def test_a_failed_write_leaves_the_old_file(tmp_path):
    target = tmp_path / "out.bin"
    target.write_bytes(b"old")

    def interrupted():
        with point_files.open_atomic(target) as stream:
            stream.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_full_disk_at_the_last_moment_leaves_the_old_file(tmp_path, monkeypatch):
    target = tmp_path / "out.bin"
    target.write_bytes(b"old")

    def full(descriptor):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with (
        pytest.raises(OSError, match="No space left") as caught,
        point_files.open_atomic(target) as stream,
    ):
        stream.write(b"new")
    assert caught.value.filename == str(target)
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_rights_and_links_stay(tmp_path):
    target, link = tmp_path / "out.bin", tmp_path / "link.bin"
    target.write_bytes(b"old")
    target.chmod(0o640)
    link.symlink_to(target)
    with point_files.open_atomic(link) as stream:
        stream.write(b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    assert stat.S_IMODE(target.stat().st_mode) == 0o640


def test_a_new_file_gets_the_usual_rights(tmp_path):
    with point_files.open_atomic(tmp_path / "out.bin") as stream:
        stream.write(b"new")
    (tmp_path / "usual.bin").touch()
    modes = {path.stat().st_mode for path in tmp_path.iterdir()}
    assert len(modes) == 1


def test_a_device_is_not_replaced():
    with pytest.raises(ValueError, match="device"), point_files.open_atomic("/dev/null"):
        pass
