"""Rules: ellipses that follow the curvature, and rules that no point supports."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from shapes import box, plane_patch, sphere, torus

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.pipeline import estimate_normals
from o3d_sofnn.rules.growth import RESIZED, SUPPORTED, discard, reshape
from o3d_sofnn.rules.refit import UNDISPUTED, read_normals, revise
from o3d_sofnn.rules.rule_base import LONGEST, fit_rules
from o3d_sofnn.sampling.local_fit import Neighborhoods


def fitted(shape, noise=0.0, **options):
    points = np.ascontiguousarray(shape.points)
    centers = points[::20]
    n = len(centers)
    where = Neighborhoods(
        centers, shape.normals[::20], np.full(n, 60), np.full(n, noise), **options
    )
    return fit_rules(KdTree(points, 1), points, shape.normals, where)


def test_rules_of_a_tube_are_long_along_it():
    shape = torus(4000, 2.0, 0.25)
    rules = fitted(shape)
    across, stretch = rules.ellipses
    ring = np.cross([0.0, 0.0, 1.0], rules.centers)
    ring /= np.linalg.norm(ring, axis=1, keepdims=True)
    assert np.median(np.abs((across * ring).sum(axis=1))) < 0.05
    assert np.median(stretch) > 1.5
    assert stretch.max() <= LONGEST


def test_rules_of_a_sphere_and_of_a_noisy_plane_are_round():
    assert np.median(fitted(sphere(4000)).ellipses[1]) < 1.1
    assert np.median(fitted(plane_patch(4000).noisy(0.005), 0.005).ellipses[1]) < 1.4


def test_an_ellipse_covers_as_many_points_as_a_circle():
    shape = torus(4000, 2.0, 0.5)
    round_ones = fitted(shape)
    across, stretch = round_ones.ellipses
    rules = fitted(shape, across=across, stretch=stretch)
    long_ones = rules.stretch > 1.5
    assert long_ones.any()
    tree = cKDTree(shape.points)
    inside = []
    for row in np.flatnonzero(long_ones)[:40]:
        near = tree.query_ball_point(rules.centers[row], 2.0 * rules.radius[row])
        u, v, _ = rules.frames[row] @ (shape.points[near] - rules.centers[row]).T
        s, r = rules.stretch[row], rules.radius[row]
        inside.append(int((s * u**2 + v**2 / s < r**2).sum()))
    assert 45 < np.median(inside) < 90


def test_rules_that_face_away_from_all_points_are_left_out():
    shape = sphere(2000)
    rules = fitted(shape)
    assert len(discard(rules)) == len(rules)
    away = np.zeros(len(rules), bool)
    away[::7] = True
    points = np.ascontiguousarray(shape.points)
    sides = np.where(away[:, None], -1.0, 1.0) * shape.normals[::20]
    where = Neighborhoods(
        points[::20], np.ascontiguousarray(sides), np.full(len(rules), 60), np.zeros(len(rules))
    )
    wrong = fit_rules(KdTree(points, 1), points, shape.normals, where)
    assert (wrong.support[away] < SUPPORTED).all()
    np.testing.assert_array_equal(discard(wrong).centers, wrong.centers[~away])


def test_every_rule_of_a_noisy_box_is_supported():
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.0, 1.0, (4000, 3))
    points[np.arange(4000), rng.integers(0, 3, 4000)] = rng.choice([-1.0, 1.0], 4000)
    points += rng.normal(0.0, 0.03, points.shape)
    assert (estimate_normals(points).rules.support >= SUPPORTED).all()


def test_neighborhoods_shrink_where_fits_are_bad_and_grow_where_they_are_good():
    good = fitted(plane_patch(4000).noisy(0.005), 0.005)
    flat = plane_patch(1000)
    x, y, _ = (15.0 * flat.points).T
    slopes = np.stack([-0.6 * np.cos(x) * np.cos(y), 0.6 * np.sin(x) * np.sin(y), x**0], axis=1)
    height = 0.04 * np.sin(x) * np.cos(y)
    waves = flat._replace(
        points=np.column_stack([flat.points[:, :2], height]),
        normals=slopes / np.linalg.norm(slopes, axis=1, keepdims=True),
    )
    bad = fitted(waves.noisy(0.002), 0.002)
    for rules, expected in ((good, RESIZED[1]), (bad, RESIZED[0])):
        factor = reshape(rules, None, None)[0] / rules.n_neighbors
        assert np.median(factor) == pytest.approx(expected, abs=0.02)
        assert factor.max() <= RESIZED[1] + 0.01
        assert factor.min() >= RESIZED[0] - 0.01


def test_neighborhoods_keep_the_limits_of_the_user():
    rules = fitted(torus(4000, 2.0, 0.25))
    size, _, stretch = reshape(rules, 60, None)
    assert (np.rint(size * stretch) <= 60).all()
    limit = float(np.median(rules.radius))
    size, _, stretch = reshape(rules, None, limit)
    area = size / rules.n_neighbors * stretch
    assert (area <= np.maximum((limit / rules.radius) ** 2, 1.0) + 0.02).all()


def blurred_box(stretch=1.0):
    """A box, the tree over it, and rules fitted with normals that are blurred across its edges."""
    shape = box(6000)
    points, tree = np.ascontiguousarray(shape.points), KdTree(shape.points, 1)
    blurred = shape.normals[tree.query(points, 12, np.inf)[1]].mean(axis=1)
    blurred /= np.linalg.norm(blurred, axis=1, keepdims=True)
    centers, size, noise = points[::20], np.full(300, 24), np.zeros(300)
    sides = shape.normals[::20]
    across = unit(np.cross(sides, [0.6, 0.0, 0.8]))
    where = Neighborhoods(centers, sides, size, noise, across, np.full(300, stretch))
    rules = fit_rules(tree, points, blurred, where)
    return shape, points, tree, rules


def test_rules_beside_an_edge_are_fitted_anew_and_gain_by_better_normals():
    shape, points, tree, rules = blurred_box()
    revised = revise(rules, tree, points, shape.normals)
    disputed = rules.support < UNDISPUTED
    assert 0 < disputed.sum() < len(rules)
    assert len(revised) == len(rules)
    kept = len(rules) - disputed.sum()
    np.testing.assert_array_equal(revised.centers[:kept], rules.centers[~disputed])
    truth = shape.normals[::20][disputed]
    before = np.einsum("rd,rd->r", rules.normals[disputed], truth)
    after = np.einsum("rd,rd->r", revised.normals[kept:], truth)
    assert (1.0 - after).mean() < 0.5 * (1.0 - before).mean()


def test_rules_with_undisputed_neighborhoods_stay():
    shape = plane_patch(2000)
    rules = fitted(shape)
    tree = KdTree(shape.points, 1)
    assert revise(rules, tree, shape.points, shape.normals) is rules
    assert not read_normals(rules, shape.points).any()


@pytest.mark.parametrize("stretch", [1.0, 2.0])
def test_third_fits_read_no_other_normals_than_those_marked(stretch):
    shape, points, tree, rules = blurred_box(stretch)
    read = read_normals(rules, points)
    assert 0 < read.sum() < len(points)
    unread = np.where(read[:, None], shape.normals, np.nan)
    revised = revise(rules, tree, points, unread)
    expected = revise(rules, tree, points, shape.normals)
    np.testing.assert_array_equal(revised.coefficients, expected.coefficients)
    np.testing.assert_array_equal(revised.normals, expected.normals)
