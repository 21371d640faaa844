"""Scripts that call Open3D's Poisson reconstruction go on with another name."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_checks import assert_valid_mesh
from shapes import sphere

import o3d_sofnn

o3d = pytest.importorskip("open3d")


def cloud_of(points):
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))


def cap():
    """Return the part of a ball above its equator: what closes it lies on no point."""
    points = sphere(4000).points
    return points[points[:, 2] > 0.0]


def test_a_script_that_trims_by_quantile():
    points = cap()
    pcd = cloud_of(points)
    mesh, densities = o3d_sofnn.create_from_point_cloud_sofnn(pcd, depth=6)
    assert_valid_mesh(np.asarray(mesh.vertices), np.asarray(mesh.triangles))
    assert len(densities) == len(mesh.vertices)
    below = np.asarray(mesh.vertices)[:, 2] < -0.2
    share = below.mean() if below.any() else 0.05
    # As in Open3D's tutorial.
    remove = np.asarray(densities) < np.quantile(densities, share)
    before = np.asarray(mesh.vertices).copy()
    mesh.remove_vertices_by_mask(remove)
    assert len(mesh.vertices) == np.count_nonzero(~remove)
    gone = before[remove]
    distance = np.asarray(cloud_of(gone).compute_point_cloud_distance(pcd))
    left = np.asarray(cloud_of(before[~remove]).compute_point_cloud_distance(pcd))
    assert np.median(distance) > np.median(left)


def test_densities_are_depths_on_the_points_and_distances_beyond():
    points = cap()
    mesh, densities = o3d_sofnn.create_from_point_cloud_sofnn(cloud_of(points), depth=6)
    densities = np.asarray(densities)
    distance = np.asarray(
        cloud_of(np.asarray(mesh.vertices)).compute_point_cloud_distance(cloud_of(points))
    )
    assert densities.max() == pytest.approx(6.0, abs=0.1)
    far = densities < 0.0
    cell = np.ptp(points, axis=0).max() / 64
    np.testing.assert_allclose(-densities[far] * cell, distance[far], rtol=1e-6)


@pytest.mark.parametrize(
    ("options", "match"),
    [({"scale": 1.5}, "scale:"), ({"linear_fit": True}, "linear_fit:"), ({"depth": 0}, "depth:")],
)
def test_what_means_nothing_here_is_refused(options, match):
    with pytest.raises(ValueError, match=match):
        o3d_sofnn.create_from_point_cloud_sofnn(cloud_of(cap()), **options)


def test_another_kind_of_cloud_is_refused():
    with pytest.raises(ValueError, match=r"pcd: expected an open3d\.geometry\.PointCloud, got"):
        o3d_sofnn.create_from_point_cloud_sofnn(cap())


def test_normals_take_what_open3d_takes():
    pcd = cloud_of(cap())
    o3d_sofnn.estimate_normals(
        pcd, o3d.geometry.KDTreeSearchParamKNN(30), fast_normal_computation=True
    )
    first = np.asarray(pcd.normals).copy()
    o3d_sofnn.estimate_normals(pcd, max_nn=30)
    np.testing.assert_array_equal(np.asarray(pcd.normals), first)
    with pytest.raises(ValueError, match="search_param and max_nn"):
        o3d_sofnn.estimate_normals(pcd, o3d.geometry.KDTreeSearchParamKNN(30), max_nn=30)
