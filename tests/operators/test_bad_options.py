"""Options out of range: an error that names the option, expected and got."""

from __future__ import annotations

import numpy as np
import pytest
import shapes

import o3d_sofnn

o3d = pytest.importorskip("open3d")


@pytest.fixture(params=["estimate_normals", "reconstruct_surface"])
def operator(request):
    return getattr(o3d_sofnn, request.param)


def test_unknown_keyword(operator, make_cloud):
    with pytest.raises(TypeError, match="knn"):
        operator(make_cloud(shapes.sphere(10).points), knn=5)


@pytest.mark.parametrize("thing", [None, np.zeros((10, 3)), "cloud.ply", 3], ids=repr)
def test_something_else_than_a_cloud(operator, thing):
    with pytest.raises(ValueError, match="pcd: expected an open3d"):
        operator(thing)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"n_threads": 0}, "n_threads"),
        ({"n_threads": -2}, "n_threads"),
        ({"n_threads": 1.5}, "n_threads"),
        ({"search_param": 30}, "search_param"),
        ({"search_param": o3d.geometry.KDTreeSearchParamKNN(2)}, "search_param: max_nn"),
        ({"search_param": o3d.geometry.KDTreeSearchParamRadius(0.0)}, "search_param: radius"),
        ({"search_param": o3d.geometry.KDTreeSearchParamRadius(np.nan)}, "search_param: radius"),
    ],
)
def test_common_options_out_of_range(operator, make_cloud, options, name):
    with pytest.raises(ValueError, match=f"^{name}: expected .*got"):
        operator(make_cloud(shapes.sphere(100).points), **options)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"depth": 0}, "depth"),
        ({"depth": 99}, "depth"),
        ({"depth": 7.5}, "depth"),
        ({"depth": True}, "depth"),
        ({"voxel_size": 0.0}, "voxel_size"),
        ({"voxel_size": -1.0}, "voxel_size"),
        ({"voxel_size": np.inf}, "voxel_size"),
        ({"voxel_size": "small"}, "voxel_size"),
        ({"depth": 7, "voxel_size": 0.1}, "depth and voxel_size"),
        ({"trim": -0.1}, "trim"),
        ({"trim": 1.1}, "trim"),
        ({"trim": np.nan}, "trim"),
        ({"use_normals": True}, "use_normals"),
    ],
)
def test_options_of_the_surface_out_of_range(make_cloud, options, name):
    with pytest.raises(ValueError, match=f"^{name}: expected .*got"):
        o3d_sofnn.reconstruct_surface(make_cloud(shapes.sphere(100).points), **options)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"viewpoint": (0.0, 0.0)}, "viewpoint"),
        ({"viewpoint": (0.0, 0.0, np.nan)}, "viewpoint"),
        ({"viewpoint": np.zeros((99, 3))}, "viewpoint"),
        ({"viewpoint": np.full((100, 3), np.nan)}, "viewpoint"),
        ({"towards": (0.0, 0.0, 0.0)}, "towards"),
        ({"towards": "up"}, "towards"),
        ({"viewpoint": (0.0, 0.0, 1.0), "towards": (0.0, 0.0, 1.0)}, "viewpoint and towards"),
    ],
)
def test_options_of_the_sides_out_of_range(make_cloud, options, name):
    for operator in (o3d_sofnn.estimate_normals, o3d_sofnn.reconstruct_surface):
        with pytest.raises(ValueError, match=f"^{name}: expected .*got"):
            operator(make_cloud(shapes.sphere(100).points), **options)


def test_sides_come_from_one_place(make_cloud):
    shape = shapes.sphere(100)
    cloud = make_cloud(shape.points, normals=shape.normals)
    with pytest.raises(ValueError, match=r"^use_normals and towards: expected"):
        o3d_sofnn.reconstruct_surface(cloud, use_normals=True, towards=(0.0, 0.0, 1.0))


@pytest.mark.parametrize("bad", [np.nan, 0.0])
def test_own_normals_that_say_nothing(family, make_cloud, bad):
    shape = shapes.sphere(100)
    cloud = make_cloud(shape.points, family, normals=np.full((100, 3), bad))
    with pytest.raises(ValueError, match=r"^use_normals: expected"):
        o3d_sofnn.reconstruct_surface(cloud, use_normals=True)
