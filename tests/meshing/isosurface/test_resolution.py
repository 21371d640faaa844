"""Cubes are as large as the data allows: coarser where it is flat, finer beside edges."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import box, plane_patch, sphere

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.meshing.isosurface.resolution import (
    choose_cubes,
    choose_levels,
    choose_voxel_size,
    flat_edges,
)
from o3d_sofnn.meshing.isosurface.spacing import local_spacing, spacing_around
from o3d_sofnn.pipeline import estimate_normals, reconstruct_surface


@pytest.fixture(scope="module")
def cube():
    points = box(20000).points
    estimate = estimate_normals(points)
    return points, estimate.spacing, estimate.rules


def test_curvature_and_accuracy_decide():
    rules = estimate_normals(sphere(8000).points).rules
    flat = flat_edges(rules)
    error = np.maximum(2.0 * rules.noise / np.sqrt(rules.n_neighbors), 1e-3 * rules.radius)
    ratio = flat / np.sqrt(8.0 * error)  # the curvature is 1
    assert 0.95 < np.median(ratio) < 1.02
    assert ratio.min() > 0.5
    assert ratio.max() < 1.5


def test_planes_allow_large_cubes_and_edges_do_not(cube):
    _, _, rules = cube
    flat = flat_edges(rules)
    from_edge = np.sort(0.5 - abs(rules.centers), axis=1)[:, 1]  # of the face that it lies on
    assert (flat[from_edge < 0.01] == 0.0).mean() > 0.9
    assert (flat[from_edge > 0.2] > rules.radius[from_edge > 0.2]).all()


def test_cubes_beside_edges_are_finer(cube):
    points, spacing, rules = cube
    flat = flat_edges(rules)
    size = choose_voxel_size(points, spacing, rules, flat)
    finest, levels = choose_levels(
        points, np.full(len(points), spacing), rules, flat, (size, np.inf)
    )
    assert finest <= 0.8 * spacing < size <= 1.6 * spacing
    near = KdTree(rules.centers, 1).query(points, 1, np.inf)[1][:, 0]
    assert levels[flat[near] == 0.0].max() < levels[flat[near] > 2.0 * size].min()


def test_who_gives_a_resolution_gets_it_everywhere(cube):
    points, spacing, rules = cube
    sparse = np.where(points[:, 0] < 0.0, spacing, 4.0 * spacing)
    size, finest, levels = choose_cubes(points, points, sparse, spacing, rules, 1.0 / 32)
    assert size == finest == pytest.approx(np.ptp(points, axis=0).max() / 32, rel=1e-2)
    assert not levels.any()


def test_triangles_have_the_size_that_the_user_gives():
    edge = 0.04
    surface = reconstruct_surface(box(20000).points, voxel_size=edge)
    assert surface.voxel_size == edge
    corners = surface.vertices[surface.triangles]
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    assert np.median(lengths) == pytest.approx(edge, rel=0.2)
    assert len(surface.triangles) == pytest.approx(2 * 6 / edge**2, rel=0.1)


@pytest.mark.parametrize("options", [{}, {"depth": 6}])
def test_a_stray_point_far_away_does_not_make_cubes_large(options):
    ball = sphere(3000).points
    stray = np.array([[1e5, 0.0, 0.0], [0.0, -1e5, 0.0]])
    alone = reconstruct_surface(ball, **options)
    surface = reconstruct_surface(np.concatenate([stray, ball]), **options)
    assert surface.voxel_size == pytest.approx(alone.voxel_size, rel=0.01)
    assert len(surface.triangles) == pytest.approx(len(alone.triangles), rel=0.02)
    assert np.abs(np.linalg.norm(surface.vertices, axis=1) - 1.0).max() < 0.01


def test_a_flat_shape_has_fewer_triangles_and_keeps_its_edges():
    surface = reconstruct_surface(box(20000).points)
    assert surface.watertight
    assert len(surface.triangles) < 4.5 * 20000
    off = abs(abs(surface.vertices).max(axis=1) - 0.5)
    assert off.mean() < 1e-4


def lines(step, gap, n_lines=40):
    """Scan lines in a plane: points a step apart on lines a gap apart."""
    along = np.arange(-0.5 * n_lines * gap, 0.5 * n_lines * gap, step)
    across = gap * (np.arange(n_lines) - 0.5 * n_lines)
    x, y = np.meshgrid(along, across)
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    return points + 0.05 * step * np.random.default_rng(0).normal(size=points.shape) * [1, 1, 0]


@pytest.mark.parametrize("ratio", [1.0, 4.0, 12.0])
def test_the_spacing_is_that_across_scan_lines(ratio):
    points = lines(1.0, ratio, 80 if ratio == 1.0 else 20)
    mean, widest = spacing_around(points, KdTree(points, 1))
    assert 0.75 * ratio < np.median(widest) < 1.25 * ratio
    assert (widest >= mean).all()
    # The area that one point covers is known, however the points lie.
    assert np.median(mean) == pytest.approx(np.sqrt(ratio), rel=0.35)


def test_the_spacing_of_a_region_holds_where_the_density_is_even():
    points = sphere(4000).points
    tree = KdTree(points, 1)
    spacing = np.full(len(points), np.sqrt(4.0 * np.pi / len(points)))
    solid = np.ones(len(points), bool)
    np.testing.assert_array_equal(local_spacing(spacing, solid, points, tree), spacing)
    sheet = local_spacing(spacing, ~solid, points, tree)
    assert (sheet == spacing).mean() > 0.99
    uneven = local_spacing(0.4 * spacing, solid, points, tree)
    assert (uneven > 0.75 * spacing).mean() > 0.95


@pytest.mark.parametrize(
    "points", [plane_patch(5000).points, lines(0.01, 0.08)], ids=["even", "lines"]
)
def test_a_sheet_has_six_triangles_a_point_at_most(points):
    points = points + 0.03 * np.sin(6.0 * points[:, :1]) * [0.0, 0.0, 1.0]
    surface = reconstruct_surface(points)
    assert len(surface.triangles) < 6 * len(points)
    assert surface.quality.near > 0.98
