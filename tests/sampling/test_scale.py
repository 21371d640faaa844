"""Scale and noise level, found without being told."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import box, join, plane_patch, sphere, torus

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.sampling.cells import sort_unique
from o3d_sofnn.sampling.scales.choice import SCALES, Limits, choose_scale
from o3d_sofnn.sampling.scales.noise import untruncated

SHAPES = {"sphere": (sphere, 2.0), "plane": (plane_patch, 1.0), "torus": (torus, 2.8)}
"""Shape and the edge of its bounding box."""


def scale_of(points, **limits):
    points = np.ascontiguousarray(points[sort_unique(points)[0]])
    return choose_scale(points, KdTree(points, 1), Limits(**limits))


@pytest.mark.parametrize("noise", [0.001, 0.003, 0.01])
@pytest.mark.parametrize("name", SHAPES)
def test_noise_level_is_found_within_fifteen_percent(name, noise):
    shape, size = SHAPES[name]
    scale = scale_of(shape(5000).noisy(noise * size).points)
    assert np.median(scale.noise) == pytest.approx(noise * size, rel=0.15)


@pytest.mark.parametrize("name", SHAPES)
def test_noise_is_found_where_neighborhoods_are_hardly_wider(name):
    shape, size = SHAPES[name]
    # A ball with 450 points has a radius of 3 standard deviations: it cuts a quarter of them off.
    scale = scale_of(shape(100_000).noisy(0.014 * size).points)
    assert np.median(scale.noise) == pytest.approx(0.014 * size, rel=0.25)


def test_some_of_the_noise_outside_a_ball_is_made_good_for():
    radius = np.ones(4)
    rms = np.array([0.0, 0.01, 0.1, 0.3])
    factor = untruncated(rms, radius)[1:] / rms[1:]
    assert untruncated(rms, radius)[0] == 0.0
    assert factor[0] == pytest.approx(1.0, abs=1e-3)
    assert factor[0] < factor[1] < factor[2] < 1.1


@pytest.mark.parametrize("name", SHAPES)
def test_clean_points_have_no_noise(name):
    shape, size = SHAPES[name]
    assert np.median(scale_of(shape(5000).points).noise) < 2e-4 * size


def test_neighborhoods_grow_with_the_noise():
    found = [
        np.median(scale_of(torus(5000).noisy(noise).points).n_neighbors)
        for noise in (0.0, 0.005, 0.03)
    ]
    assert found == sorted(found)
    assert found[0] < found[2]


def test_neighborhoods_shrink_at_edges():
    scale = scale_of(box(5000).noisy(0.002).points)
    assert np.median(scale.n_neighbors) < 100


def test_noise_is_found_region_by_region():
    left, right = sphere(4000).noisy(0.01), sphere(4000, seed=2).noisy(0.03).moved((4.0, 0.0, 0.0))
    scale = scale_of(join(left, right).points)
    for shape, noise in ((left, 0.01), (right, 0.03)):
        found = np.median(scale.noise[scale.at(shape.points)])
        assert found == pytest.approx(noise, rel=0.15)


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_scale_follows_the_unit(factor):
    shape = torus(3000).noisy(0.01)
    one, other = scale_of(shape.points), scale_of(shape.scaled(factor).points)
    np.testing.assert_allclose(np.median(other.noise), factor * np.median(one.noise), rtol=1e-3)
    np.testing.assert_allclose(np.median(other.spacing), factor * np.median(one.spacing), rtol=1e-3)


def test_spacing_is_the_edge_of_the_square_of_a_point():
    scale = scale_of(sphere(5000).points)
    assert np.median(scale.spacing) == pytest.approx(np.sqrt(4.0 * np.pi / 5000), rel=0.1)


def test_limits_are_kept():
    points = torus(3000).noisy(0.02).points
    assert scale_of(points, max_nn=27).n_neighbors.max() <= 27
    free = scale_of(points)
    limited = scale_of(points, radius=0.2)
    assert np.median(limited.n_neighbors) < np.median(free.n_neighbors)


@pytest.mark.parametrize("n", [4, 7, 30])
def test_few_points_have_a_scale(n):
    scale = scale_of(sphere(n).points)
    assert (scale.n_neighbors <= max(n, SCALES[0])).all()
    assert np.isfinite(scale.noise).all()
    assert (scale.spacing > 0.0).all()


def rings_below(n_rings=40, per_ring=200, noise=0.005, seed=0):
    """Scan a floor at z = 0 from 1.2 above it, straight down: dense rings with errors of range."""
    rng = np.random.default_rng(seed)
    radius = np.repeat(0.02 * np.arange(1, n_rings + 1), per_ring)
    angle = np.tile(np.arange(per_ring) * (2.0 * np.pi / per_ring), n_rings)
    floor = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(len(angle))], axis=1)
    sight = np.array([0.0, 0.0, 1.2]) - floor
    distance = np.linalg.norm(sight, axis=1)[:, None]
    return floor - sight / distance * rng.normal(0.0, noise, distance.shape), sight


def test_where_the_sensor_stood_fits_are_wider_than_the_error_of_its_range():
    points, sight = rings_below()
    order = sort_unique(points)[0]
    points, sight = np.ascontiguousarray(points[order]), sight[order]
    tree = KdTree(points, 1)
    blind = choose_scale(points, tree, Limits())
    seeing = choose_scale(points, tree, Limits(), sight=sight)
    assert (blind.least == SCALES[0]).all()
    near = np.linalg.norm(seeing.places[:, :2], axis=1) < 0.1
    assert np.median(blind.n_neighbors[near]) < np.median(seeing.n_neighbors[near])
    np.testing.assert_allclose(np.median(seeing.noise[near]), 0.005, rtol=0.3)
    assert (seeing.n_neighbors >= seeing.least).all()
    assert (seeing.enough(np.full(len(points), 9), points) >= 9).all()


@pytest.mark.parametrize("limits", [{"max_nn": 30}, {"radius": 0.015}])
def test_a_sensor_does_not_widen_fits_beyond_what_the_user_allows(limits):
    points, sight = rings_below()
    order = sort_unique(points)[0]
    points, sight = np.ascontiguousarray(points[order]), sight[order]
    tree = KdTree(points, 1)
    free = choose_scale(points, tree, Limits(), sight=sight)
    held = choose_scale(points, tree, Limits(**limits), sight=sight)
    size = np.full(len(held.places), SCALES[0])
    for scale, within in ((free, False), (held, True)):
        enough = scale.enough(size, held.places)
        reach = tree.query(held.places, int(enough.max()), np.inf)[0]
        radius = reach[np.arange(len(reach)), enough - 1]
        fits = (enough <= limits.get("max_nn", np.inf)) & (radius <= limits.get("radius", np.inf))
        assert (fits | (enough == SCALES[0])).all() == within


def test_a_sensor_that_stood_anywhere_changes_nothing_where_points_are_clean():
    points = sphere(3000).points
    points = np.ascontiguousarray(points[sort_unique(points)[0]])
    tree = KdTree(points, 1)
    blind = choose_scale(points, tree, Limits())
    seeing = choose_scale(points, tree, Limits(), sight=np.array([0.0, 0.0, 9.0]) - points)
    np.testing.assert_array_equal(seeing.n_neighbors, blind.n_neighbors)
    np.testing.assert_array_equal(seeing.noise, blind.noise)
