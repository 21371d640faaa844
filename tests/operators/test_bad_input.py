"""Every kind of difficult cloud: an error that names the argument, or the documented result."""

from __future__ import annotations

import numpy as np
import pytest
import shapes
from mesh_checks import assert_valid_mesh

import o3d_sofnn
from o3d_sofnn import adapters
from o3d_sofnn.geometry import mesh_properties

o3d = pytest.importorskip("open3d")

OPERATORS = ["estimate_normals", "reconstruct_surface"]
N = 1500


@pytest.fixture(params=OPERATORS)
def operator(request):
    return getattr(o3d_sofnn, request.param)


def agreement(normals, shape):
    """Return the share of normals within 45 degrees of the true ones, sign counted."""
    return np.mean(np.einsum("ij,ij->i", normals, shape.normals) > np.sqrt(0.5))


def test_normals_of_an_empty_cloud_warn_and_return_it(family, make_cloud, caplog):
    cloud = make_cloud(np.zeros((0, 3)), family)
    assert o3d_sofnn.estimate_normals(cloud) is cloud
    assert "no points" in caplog.text
    assert o3d_sofnn.estimate_normals(cloud, return_details=True) == (cloud, None)


def test_a_tensor_cloud_without_positions_is_empty():
    cloud = o3d.t.geometry.PointCloud()
    assert o3d_sofnn.estimate_normals(cloud) is cloud


def test_a_mesh_of_an_empty_cloud_is_an_error(family, make_cloud):
    with pytest.raises(ValueError, match="pcd: expected at least 4 finite points, got 0"):
        o3d_sofnn.reconstruct_surface(make_cloud(np.zeros((0, 3)), family))


@pytest.mark.parametrize("count", [1, 2, 3])
def test_too_few_points(operator, family, make_cloud, count):
    cloud = make_cloud(np.eye(3)[:count], family)
    with pytest.raises(ValueError, match=f"pcd: expected at least 4 finite points, got {count}"):
        operator(cloud)


def test_four_points_are_enough_for_normals(make_cloud, normals_of):
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    normals = normals_of(o3d_sofnn.estimate_normals(make_cloud(corners)))
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)


@pytest.mark.parametrize("count", [5, 10, 30, 100])
def test_few_points_have_normals(make_cloud, normals_of, count):
    shape = shapes.sphere(count)
    normals = normals_of(o3d_sofnn.estimate_normals(make_cloud(shape.points)))
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)


@pytest.mark.parametrize("max_nn", [6, 10, 30])
def test_small_neighborhoods(make_cloud, normals_of, max_nn):
    shape = shapes.sphere(N)
    search_param = o3d.geometry.KDTreeSearchParamKNN(max_nn)
    normals = normals_of(o3d_sofnn.estimate_normals(make_cloud(shape.points), search_param))
    assert agreement(normals, shape) > 0.99


@pytest.mark.parametrize("scale", [1e-200, 1e-60, 1e60, 1e200])
def test_lengths_whose_powers_overflow(operator, make_cloud, scale):
    with pytest.raises(ValueError, match="pcd: expected coordinates below"):
        operator(make_cloud(shapes.sphere(N).points * scale))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_rows_that_are_not_finite(family, make_cloud, normals_of, caplog, bad):
    shape = shapes.sphere(N)
    rows = np.array([0, 5, 700, N - 1])
    broken = shape.points.copy()
    broken[rows, [0, 1, 2, 0]] = bad
    cloud, details = o3d_sofnn.estimate_normals(make_cloud(broken, family), return_details=True)
    normals = normals_of(cloud)
    assert "4 of 1500 points are not finite" in caplog.text
    assert any("4 of 1500" in warning for warning in details.warnings)
    assert not normals[rows].any()
    assert details.outliers[rows].all()
    assert not details.confidence[rows].any()
    assert np.array_equal(adapters.read_cloud(cloud).points, broken, equal_nan=True)

    kept = np.delete(np.arange(N), rows)
    alone = normals_of(o3d_sofnn.estimate_normals(make_cloud(shape.points[kept], family)))
    assert np.array_equal(normals[kept], alone)


def test_a_mesh_leaves_out_rows_that_are_not_finite(family, make_cloud):
    shape = shapes.sphere(N)
    broken = np.insert(shape.points, [0, 700], np.nan, axis=0)
    labels = np.ones((len(broken), 3))
    labels[np.isnan(broken)] = 0.0
    mesh, details = o3d_sofnn.reconstruct_surface(
        make_cloud(broken, family, colors=labels), return_details=True
    )
    assert_valid_mesh(mesh, components=1)
    vertices, _ = adapters.read_mesh(mesh)
    assert np.allclose(vertices.attributes["colors"], 1.0)
    assert details.source_weights.shape[1] == len(broken)
    assert details.normals.normals.shape == broken.shape
    clean, _ = adapters.read_mesh(o3d_sofnn.reconstruct_surface(make_cloud(shape.points, family)))
    assert np.array_equal(vertices.points, clean.points)


def test_no_finite_row_at_all(operator, family, make_cloud):
    with pytest.raises(ValueError, match="pcd: expected at least 4 finite points, got 0"):
        operator(make_cloud(np.full((10, 3), np.nan), family))


@pytest.mark.parametrize("place", [0.0, 1.0, 1e6])
def test_all_points_equal(operator, family, make_cloud, place):
    with pytest.raises(ValueError, match="points"):
        operator(make_cloud(np.full((100, 3), place), family))


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_collinear_points(operator, family, make_cloud, offset):
    line = np.linspace(0.0, 1.0, 100)[:, np.newaxis] * [1.0, 2.0, 3.0] + offset
    with pytest.raises(ValueError, match="points"):
        operator(make_cloud(line, family))


@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_coplanar_points_have_normals(family, make_cloud, normals_of, offset):
    patch = shapes.plane_patch(N).moved(offset)
    normals = normals_of(o3d_sofnn.estimate_normals(make_cloud(patch.points, family)))
    assert np.allclose(np.abs(normals @ [0.0, 0.0, 1.0]), 1.0, atol=1e-6)
    assert np.allclose(normals, normals[0], atol=1e-3)


def test_coplanar_points_enclose_nothing(family, make_cloud):
    with pytest.raises(ValueError, match="points"):
        o3d_sofnn.reconstruct_surface(make_cloud(shapes.plane_patch(N).points, family), closed=True)


def test_coplanar_points_give_an_open_mesh_with_trim(family, make_cloud):
    mesh = o3d_sofnn.reconstruct_surface(make_cloud(shapes.plane_patch(N).points, family), trim=0.5)
    vertices, triangles = adapters.read_mesh(mesh)
    assert np.abs(vertices.points[:, 2]).max() < 0.02
    # The sheet may reach beyond the outermost points by two spacings on every side.
    area = mesh_properties.triangle_areas(vertices.points, triangles).sum()
    assert 0.95 < area < (1.0 + 4.0 / np.sqrt(N)) ** 2


def test_half_of_the_points_twice(family, make_cloud, normals_of):
    shape = shapes.sphere(N)
    double = shapes.join(shape, shapes.Shape(*(rows[: N // 2] for rows in shape)))
    assert (
        agreement(normals_of(o3d_sofnn.estimate_normals(make_cloud(double.points, family))), double)
        == 1
    )
    assert_valid_mesh(
        o3d_sofnn.reconstruct_surface(make_cloud(double.points, family)), components=1
    )


def test_every_point_twice(make_cloud, normals_of):
    double = shapes.join(shapes.sphere(N), shapes.sphere(N))
    normals = normals_of(o3d_sofnn.estimate_normals(make_cloud(double.points)))
    assert agreement(normals, double) == 1
    assert np.allclose(normals[:N], normals[N:])


def test_coordinates_far_from_the_origin(family, make_cloud, normals_of):
    shape = shapes.sphere(N).moved((5e5, 4.9e6, 1e6))
    normals = normals_of(o3d_sofnn.estimate_normals(make_cloud(shape.points, family)))
    assert agreement(normals, shape) == 1
    mesh = o3d_sofnn.reconstruct_surface(make_cloud(shape.points, family))
    assert_valid_mesh(mesh, components=1)
    vertices, _ = adapters.read_mesh(mesh)
    radii = np.linalg.norm(vertices.points - [5e5, 4.9e6, 1e6], axis=1)
    assert np.abs(radii - 1.0).max() < 0.05


@pytest.mark.parametrize("scale", [1e-40, 1e-6, 1e6, 1e40])
def test_any_unit(make_cloud, normals_of, scale):
    shape = shapes.sphere(N).scaled(scale)
    assert agreement(normals_of(o3d_sofnn.estimate_normals(make_cloud(shape.points))), shape) == 1
    assert_valid_mesh(o3d_sofnn.reconstruct_surface(make_cloud(shape.points)), components=1)


def test_two_objects_far_apart(family, make_cloud, normals_of):
    shape = shapes.two_spheres(2 * N, distance=1000.0)
    normals = normals_of(o3d_sofnn.estimate_normals(make_cloud(shape.points, family)))
    assert agreement(normals, shape) == 1
    mesh = o3d_sofnn.reconstruct_surface(make_cloud(shape.points, family))
    assert_valid_mesh(mesh, components=2)
    vertices, _ = adapters.read_mesh(mesh)
    near = np.where(vertices.points[:, :1] < 500.0, [[0.0, 0.0, 0.0]], [[1000.0, 0.0, 0.0]])
    assert np.abs(np.linalg.norm(vertices.points - near, axis=1) - 1.0).max() < 0.1


def test_single_precision_stays_single(make_cloud):
    shape = shapes.sphere(N)
    cloud = make_cloud(shape.points.astype(np.float32), "tensor")
    o3d_sofnn.estimate_normals(cloud)
    assert cloud.point["normals"].dtype == o3d.core.float32
    assert agreement(cloud.point["normals"].numpy(), shape) == 1
    mesh = o3d_sofnn.reconstruct_surface(cloud)
    assert mesh.vertex["positions"].dtype == o3d.core.float32
    assert_valid_mesh(mesh, components=1)


def test_integer_coordinates(make_cloud):
    shape = shapes.sphere(N, radius=1000.0)
    cloud = make_cloud(np.rint(shape.points).astype(np.int32), "tensor")
    o3d_sofnn.estimate_normals(cloud)
    assert cloud.point["normals"].dtype == o3d.core.float64
    assert agreement(cloud.point["normals"].numpy(), shape) == 1


class CudaCloud(o3d.t.geometry.PointCloud):
    """A cloud that says it is on a GPU, for machines without one."""

    @property
    def device(self):
        return o3d.core.Device("CUDA:0")


@pytest.fixture
def sent(monkeypatch):
    """Record what is sent to which device; the tensors stay where they are."""
    log = []

    def stay(tensor, device):
        log.append((tensor.shape, str(device)))
        return tensor

    monkeypatch.setattr(adapters, "_to_device", stay)
    return log


def test_a_gpu_cloud_gets_its_results_on_its_device(sent):
    shape = shapes.sphere(N)
    cloud = CudaCloud(o3d.core.Tensor(shape.points))
    assert o3d_sofnn.estimate_normals(cloud) is cloud
    assert agreement(cloud.point["normals"].numpy(), shape) == 1
    assert sent == [(o3d.core.SizeVector([N, 3]), "CUDA:0")]

    sent.clear()
    mesh = o3d_sofnn.reconstruct_surface(cloud)
    assert_valid_mesh(mesh, components=1)
    assert len(sent) == len(["positions", "indices", "normals"])
    assert {device for _, device in sent} == {"CUDA:0"}


@pytest.mark.skipif(not o3d.core.cuda.is_available(), reason="needs a GPU")
def test_a_cloud_on_a_real_gpu():
    shape = shapes.sphere(N)
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(shape.points)).cuda()
    o3d_sofnn.estimate_normals(cloud)
    assert cloud.point["normals"].is_cuda
    assert agreement(cloud.point["normals"].cpu().numpy(), shape) == 1
