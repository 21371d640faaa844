"""Options out of range: an error that names the option, expected and got."""

from __future__ import annotations

import decimal
import fractions
import warnings

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


@pytest.mark.parametrize("thing", [None, np.zeros((10, 2)), "cloud.ply", 3], ids=repr)
def test_something_else_than_a_cloud(operator, thing):
    with pytest.raises(
        ValueError, match=r"pcd: expected an \(n, 3\) array|points: expected shape \(n, 3\)"
    ):
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
        ({"return_details": "no"}, "return_details"),
        ({"return_details": np.zeros(2, bool)}, "return_details"),
        ({"print_progress": "no"}, "print_progress"),
        ({"print_progress": None}, "print_progress"),
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
        ({"use_normals": "no"}, "use_normals"),
        ({"use_normals": np.ones(2)}, "use_normals"),
        ({"target_triangles": 3}, "target_triangles"),
        ({"precision": 0}, "precision"),
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
        ({"viewpoint": (0.0, 1e300, 0.0)}, "viewpoint"),
        ({"viewpoint": np.full((100, 3), -1e300)}, "viewpoint"),
        ({"towards": (0.0, 0.0, 0.0)}, "towards"),
        ({"towards": "up"}, "towards"),
        ({"viewpoint": (0.0, 0.0, 1.0), "towards": (0.0, 0.0, 1.0)}, "viewpoint and towards"),
    ],
)
def test_options_of_the_sides_out_of_range(make_cloud, options, name):
    for operator in (o3d_sofnn.estimate_normals, o3d_sofnn.reconstruct_surface):
        with pytest.raises(ValueError, match=f"^{name}: expected .*got"):
            operator(make_cloud(shapes.sphere(100).points), **options)


class Hostile:
    """Whatever is asked of it fails, in its own way."""

    def __getattr__(self, name):
        raise RuntimeError(name)

    def __repr__(self):
        raise RuntimeError("no text")

    def __float__(self):
        raise ZeroDivisionError

    __index__ = __array__ = __bool__ = __len__ = __iter__ = __float__


WRONG_ANYWHERE = [
    10**400,
    -(10**5000),  # too long for a text
    float("inf"),
    float("nan"),
    np.longdouble("1e4000"),
    1j,
    np.complex128(1j),
    "1",
    b"1",
    "",
    [],
    {},
    {1, 2, 3},
    [1.0],
    np.array([1]),
    [[1, 2, 3], [4, 5]],
    [10**400, 0, 0],
    [1j, 0, 0],
    np.array([1j, 0, 0]),
    ["1", "2", "3"],
    [None, 0, 0],
    np.full((2, 2, 3), 1.0),
    np.array(["2020-01-01"] * 3, "datetime64[D]"),
    decimal.Decimal("sNaN"),
    object(),
    Hostile(),
    [Hostile()] * 3,
    print,
]


@pytest.mark.parametrize("value", WRONG_ANYWHERE, ids=lambda value: type(value).__name__)
@pytest.mark.parametrize(
    "name",
    [
        *("depth", "voxel_size", "trim", "target_triangles", "precision", "viewpoint", "towards"),
        *("n_threads", "search_param", "use_normals", "return_details"),
        *("closed", "max_nn", "radius"),
    ],
)
def test_values_of_any_kind_are_refused_in_one_line(make_cloud, name, value):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(ValueError, match=f"^{name}: expected [^\n]*, got [^\n]+$") as caught:
            o3d_sofnn.reconstruct_surface(make_cloud(np.eye(4, 3)), **{name: value})
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    "options",
    [
        {"voxel_size": decimal.Decimal("0.25"), "n_threads": 2**31 - 1},
        {"voxel_size": fractions.Fraction(1, 4), "towards": (fractions.Fraction(1), 0, 10**15)},
        {"voxel_size": np.float32(0.25), "viewpoint": np.array([0, 0, 9], np.int8)},
        {"voxel_size": np.array(0.25), "target_triangles": 2**31 - 1, "print_progress": 0},
        {"depth": np.int8(3), "use_normals": np.False_, "n_threads": np.uint64(1)},
        {"viewpoint": np.full((100, 3), 9.0, order="F"), "depth": 3},
    ],
)
def test_numbers_of_any_kind_are_taken(make_cloud, options):
    mesh = o3d_sofnn.reconstruct_surface(make_cloud(shapes.sphere(100).points), **options)
    assert len(mesh.triangles) > 3


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
