"""Places that stand for the points where sides are decided."""

from __future__ import annotations

import numpy as np
from shapes import box, sphere

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.orientation.viewpoint import orient_points
from o3d_sofnn.sampling.cells import sort_unique
from o3d_sofnn.sampling.representatives import local_spacing, representatives


def sorted_points(points):
    return np.ascontiguousarray(points[sort_unique(points)[0]])


def plates(count, n=1000, thickness=0.2, noise=0.002):
    """Points in Morton order and normals of equal plates side by side."""
    shapes = [box(n, (1.0, 1.0, thickness), seed=i).noisy(noise, seed=i) for i in range(count)]
    side = int(np.ceil(np.sqrt(count)))
    points = np.concatenate(
        [s.points + 1.5 * np.array([i % side, i // side, 0.0]) for i, s in enumerate(shapes)]
    )
    order = sort_unique(points)[0]
    return points[order], np.concatenate([s.normals for s in shapes])[order]


def test_few_representatives_stand_for_many_points():
    points = sorted_points(sphere(40_000).points)
    places, stands = representatives(points, 0.0, 0.02)
    assert len(points) / 8 < len(places) < len(points) / 2
    assert np.abs(np.linalg.norm(places, axis=1) - 1.0).max() < 0.01
    count = np.bincount(stands, minlength=len(places))
    means = np.stack([np.bincount(stands, column) / count for column in points.T], axis=1)
    np.testing.assert_allclose(places, means, atol=1e-12)
    few = sphere(50).points
    assert representatives(few, 0.0, 0.5)[0] is few


def test_representatives_of_a_thick_layer_are_some_of_its_points():
    points = sorted_points(sphere(40_000).points)
    places, stands = representatives(points, 9.0, 1.0)
    assert len(places) == len(representatives(points, 0.0, 1.0)[0])
    # In the same order, evenly spread.
    rows = KdTree(points, 1).query(places, 1, np.inf)[1][:, 0]
    np.testing.assert_array_equal(points[rows], places)
    assert np.ptp(np.diff(rows)) <= 1
    assert np.abs(rows[stands] - np.arange(len(points))).max() <= np.diff(rows).max()


def test_many_thin_plates_are_right_as_one_of_them_is():
    points, normals = plates(144)
    places = representatives(points, 0.002, 0.05)[0]
    assert len(places) > 120 * 144  # 60 each, too few, if only their total number counted
    sides = orient_points(points, 0.002, 0.05).normals
    wrong = (np.einsum("nd,nd->n", sides, normals) < 0.0).mean()
    assert wrong < 1e-3


def test_cells_keep_all_points_when_they_are_divided():
    points = plates(144)[0]
    places, stands = representatives(points, 0.002, 0.05)
    count = np.bincount(stands, minlength=len(places))
    assert count.min() >= 1
    means = np.stack([np.bincount(stands, column) / count for column in points.T], axis=1)
    np.testing.assert_allclose(places, means, atol=1e-9)


def test_spacing_is_that_of_the_place():
    rng = np.random.default_rng(0)
    even, spot = rng.uniform(0.0, 1.0, (2, 10_000, 2)) * np.array([[[1.0]], [[0.2]]])
    x = sorted_points(np.column_stack([np.concatenate([even, spot]), np.zeros(20_000)]))
    spacing = local_spacing(x, KdTree(x, 1))
    within, far = (x[:, :2] < 0.19).all(axis=1), (x[:, :2] > 0.3).any(axis=1)
    assert 4.5 < np.median(spacing[far]) / np.median(spacing[within]) < 5.8  # 26 times as dense
