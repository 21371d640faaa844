"""The unit of a cloud: far points and dense spots do not decide it."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from mesh_checks import assert_valid_mesh
from shapes import sphere

from o3d_sofnn import pipeline
from o3d_sofnn.sampling.normalization import FAR, RESOLUTION, unit_cube

N = 400
SPHERE = sphere(N)


def assert_covers(cloud, points):
    """Every row is named by the point that stands for it, within the resolution."""
    back = cloud.extent * cloud.points + cloud.middle
    kept = cloud.near[cloud.inverse]
    off = np.abs(back[cloud.inverse] - points).max(axis=1)
    assert (off[kept] <= 1.01 * RESOLUTION * cloud.extent + 1e-15 * np.abs(points).max()).all()
    np.testing.assert_array_equal(cloud.inverse[cloud.first], np.arange(len(cloud.first)))
    assert np.abs(cloud.points[cloud.near]).max() <= 0.5 + 1e-12


def right(points, rows=slice(None)):
    """Share of the normals of the sphere that face outwards; all of them are unit vectors."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        estimate = pipeline.estimate_normals(points, n_threads=1)
    np.testing.assert_allclose(np.linalg.norm(estimate.normals, axis=1), 1.0, atol=1e-9)
    assert np.isfinite(estimate.confidence).all()
    assert np.isfinite(estimate.noise).all()
    cosine = np.einsum("nd,nd->n", estimate.normals[:N][rows], SPHERE.normals[rows])
    return float((cosine > 0.7).mean()), estimate


def test_an_ordinary_cloud_fills_the_unit_cube():
    points = 7.0 * SPHERE.points + [5e5, 4.9e6, 100.0]
    cloud = unit_cube(points)
    low, high = points.min(axis=0), points.max(axis=0)
    np.testing.assert_array_equal(cloud.middle, 0.5 * (low + high))
    assert cloud.extent == (high - low).max()
    assert cloud.near.all()
    assert not cloud.warnings
    np.testing.assert_array_equal(cloud.points, (points[cloud.first] - cloud.middle) / cloud.extent)
    assert_covers(cloud, points)


@pytest.mark.parametrize("distance", [2.0, 0.9 * FAR])
def test_points_not_very_far_away_stay(distance):
    """All of the box is in the unit then: its middle and size do not jump where points move."""
    points = np.concatenate([SPHERE.points, [[distance, 0.0, 0.0]]])
    cloud = unit_cube(points)
    assert cloud.near.all()
    assert not cloud.warnings
    assert cloud.extent == np.ptp(points[:, 0])


@pytest.mark.parametrize("distance", [1e4, 1e9, 1e15, 1e40])
def test_far_outliers_do_not_decide_the_unit(distance):
    rng = np.random.default_rng(0)
    far = distance * rng.normal(size=(5, 3))
    points = np.concatenate([SPHERE.points, far, far[:2]])
    alone, cloud = unit_cube(SPHERE.points), unit_cube(points)
    assert cloud.extent == alone.extent
    np.testing.assert_array_equal(cloud.middle, alone.middle)
    np.testing.assert_array_equal(np.flatnonzero(~cloud.near[cloud.inverse]), np.arange(N, N + 7))
    assert np.abs(cloud.points).max() < 1.001 * FAR
    assert any("7 of 407" in warning for warning in cloud.warnings)
    assert_covers(cloud, points)
    share, estimate = right(points)
    assert share == 1.0
    assert estimate.outliers[N:].all()
    np.testing.assert_array_equal(
        estimate.normals[:N], pipeline.estimate_normals(SPHERE.points).normals
    )
    mesh = pipeline.reconstruct_surface(points, n_threads=1)
    assert_valid_mesh(mesh.vertices, mesh.triangles, components=1)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 1.0).max() < 0.1


@pytest.mark.parametrize("size", [1e-15, 1e-12, 1e-9, 1e-8])
@pytest.mark.parametrize("place", ["centre", "surface"])
def test_a_dense_spot_is_one_point(size, place):
    rng = np.random.default_rng(0)
    spot = (SPHERE.points[3] if place == "surface" else 0.0) + size * rng.normal(size=(900, 3))
    points = np.concatenate([SPHERE.points, spot])
    cloud = unit_cube(points)
    assert N <= len(cloud.points) <= N + 8  # a wall of the lattice may part it
    assert cloud.near.all()
    assert any("of 1300 points are closer to others" in warning for warning in cloud.warnings)
    assert_covers(cloud, points)
    assert right(points)[0] > 0.995


def test_an_outlier_and_a_dense_spot():
    rng = np.random.default_rng(0)
    spot = [2.0, 0.0, 0.0] + 1e-12 * rng.normal(size=(100, 3))
    points = np.concatenate([SPHERE.points, [[1e4, 0.0, 0.0]], spot])
    share, estimate = right(points)
    assert share == 1.0
    assert len(estimate.warnings) == 2
    assert estimate.outliers[N]


def test_the_corners_of_a_cube_with_jitter_below_rounding():
    corners = np.array(np.meshgrid([0.0, 1.0], [0.0, 1.0], [0.0, 1.0])).reshape(3, -1).T
    rng = np.random.default_rng(0)
    points = np.repeat(corners, 5, axis=0) + 1e-14 * rng.normal(size=(40, 3))
    cloud = unit_cube(points)
    assert len(cloud.points) == 8
    np.testing.assert_array_equal(cloud.inverse, np.repeat(cloud.inverse[::5], 5))
    estimate = pipeline.estimate_normals(points, n_threads=1)
    np.testing.assert_allclose(np.linalg.norm(estimate.normals, axis=1), 1.0, atol=1e-9)


def test_what_stands_around_a_dense_spot_is_the_scene():
    """An octahedron: without the outermost points along each axis nothing but the spot is left."""
    rng = np.random.default_rng(0)
    corners = np.concatenate([np.eye(3), -np.eye(3)])
    for spot in (np.zeros((1, 3)), 1e-12 * rng.normal(size=(30, 3))):
        cloud = unit_cube(np.concatenate([corners, spot]))
        assert cloud.near.all()
        assert cloud.extent == 2.0
        assert len(cloud.points) == 7


@pytest.mark.parametrize(("distance", "resolved"), [(1e3, True), (1e6, True), (1e8, False)])
def test_two_spheres_far_apart(distance, resolved):
    points = np.concatenate([SPHERE.points, SPHERE.points + np.array([distance, 0.0, 0.0])])
    if resolved:
        assert right(points)[0] == 1.0
    else:
        with pytest.raises(ValueError, match="points: parts are more than 3e"):
            unit_cube(points)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_order_of_the_points_does_not_decide(seed):
    rng = np.random.default_rng(seed)
    order = rng.permutation(503)
    spot = 1e-12 * rng.normal(size=(100, 3))
    points = np.concatenate([SPHERE.points, spot, 1e7 * rng.normal(size=(3, 3))])
    one, other = unit_cube(points), unit_cube(points[order])
    assert one.extent == other.extent
    np.testing.assert_array_equal(one.middle, other.middle)
    np.testing.assert_array_equal(one.near[one.inverse][order], other.near[other.inverse])
    assert len(one.points) == len(other.points)


@pytest.mark.parametrize("scale", [1e-45, 1e-6, 1e6, 1e45])
def test_any_unit(scale):
    assert right(scale * SPHERE.points)[0] == 1.0


@pytest.mark.parametrize("radius", [1.0, 1e-3, 1e-6])
def test_offsets_of_maps(radius):
    assert right(radius * SPHERE.points + [5e5, 4.9e6, 1e3])[0] == 1.0


@pytest.mark.parametrize("z", [1e-300, 1e-30, 1e-12])
def test_a_hardly_thick_cloud_is_a_sheet(z):
    points = SPHERE.points * [1.0, 1.0, z]
    right(points)
    with pytest.raises(ValueError, match="points lie in one plane"):
        unit_cube(points, enclosing=True)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (SPHERE.points[:3], "points: at least 4 rows"),
        (np.tile(SPHERE.points[:3], (5, 1)), "points: at least 4 distinct"),
        (np.ones((9, 3)), "points are all equal"),
        (np.arange(9.0)[:, None] * [1.0, 2.0, 3.0], "points are all equal or lie on one line"),
        (SPHERE.points * 1e-200, "points: expected coordinates"),
        (SPHERE.points * 1e200, "points: expected coordinates"),
        (np.where(np.arange(N)[:, None] == 7, np.nan, SPHERE.points), "points: finite"),
        (SPHERE.points + 1e18, "points are all equal"),
        # One line of spots, once what is below the resolution is one point.
        (SPHERE.points * [1.0, 1e-12, 1e-12], "points are all equal or lie on one line"),
    ],
)
def test_what_has_no_surface_is_an_error_that_names_the_points(points, message):
    with pytest.raises(ValueError, match=message):
        unit_cube(points)
