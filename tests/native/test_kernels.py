"""Every native kernel against its slow twin in o3d_sofnn.reference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_data import MIRROR, places_near, random_rules, random_terms, unit_data, view
from shapes import box, sphere, torus

from o3d_sofnn import _kernels, reference
from o3d_sofnn.reference.sampling.typical_data import first_centers
from o3d_sofnn.sampling.cells import build_octree
from o3d_sofnn.sofnn.fuzzy_c_means import fuzzy_c_means, partition_memberships


def random_points(n, seed=0):
    return np.random.default_rng(seed).normal(size=(n, 3))


def assert_same_neighbors(points, x, k, max_distance=np.inf, n_threads=1):
    tree = _kernels.KdTree(points, n_threads)
    distance, index = tree.query(x, k, max_distance)
    expected_distance, expected_index = reference.query(points, x, k, max_distance)
    np.testing.assert_array_equal(index, expected_index)
    # The compiler may add three squares in another order than numpy.
    np.testing.assert_allclose(distance, expected_distance, rtol=4e-16, atol=0.0)


# --- k-d tree


@pytest.mark.parametrize("n", [1, 2, 12, 13, 100, 1000])
@pytest.mark.parametrize("k", [1, 5, 40])
def test_neighbors_are_those_of_a_full_search(n, k):
    points = random_points(n)
    assert_same_neighbors(points, np.concatenate([points[:50], random_points(50, seed=1)]), k)


def test_more_neighbors_than_points_are_padded():
    tree = _kernels.KdTree(random_points(3), 1)
    distance, index = tree.query(random_points(2, seed=1), 5, np.inf)
    assert tree.size == 3
    assert np.isinf(distance[:, 3:]).all()
    assert (index[:, 3:] == 3).all()
    assert (np.sort(index[:, :3], axis=1) == np.arange(3)).all()


def test_no_points_no_neighbors():
    distance, index = _kernels.KdTree(np.empty((0, 3)), 1).query(np.zeros((1, 3)), 2, np.inf)
    assert np.isinf(distance).all()
    assert (index == 0).all()


def test_distance_limit_is_inclusive():
    points = np.arange(5.0)[:, None] * [1.0, 0.0, 0.0]
    assert_same_neighbors(points, points, 5, max_distance=2.0)
    tree = _kernels.KdTree(points, 1)
    assert (np.isfinite(tree.query(points[:1], 5, 2.0)[0]).sum(axis=1) == 3).all()
    assert (np.isfinite(tree.query(points[:1], 5, 0.0)[0]).sum(axis=1) == 1).all()


def test_neighbors_of_repeated_points_come_by_index():
    points = np.repeat(random_points(7), 30, axis=0)
    assert_same_neighbors(points, points[::30], 45)
    assert_same_neighbors(np.zeros((200, 3)), np.zeros((1, 3)), 17)


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 400),
    side=st.integers(1, 8),
    step=st.sampled_from([1.0, 0.25, 0.1, 1 / 3, 0.3]),
    k=st.integers(1, 20),
)
def test_ties_on_a_lattice_come_by_index(seed, n, side, step, k):
    rng = np.random.default_rng(seed)
    points = rng.integers(0, side, (n, 3)) * step
    places = np.concatenate([points[:20], points[:20] + 0.5 * step])
    assert_same_neighbors(points, places, k)


@pytest.mark.parametrize("step", [0.1, 0.3, 1 / 3])
def test_ties_on_a_flat_lattice_that_is_no_power_of_two(step):
    points = np.stack(np.meshgrid(np.arange(9), np.arange(9), np.arange(4)), -1).reshape(-1, 3)
    points = np.random.default_rng(0).permutation(points * step)
    for k in (7, 18, 19, 27):
        assert_same_neighbors(points, np.concatenate([points, points + 0.5 * step]), k)


@pytest.mark.parametrize("k", [1, 9, 40])
def test_crowded_places(k):
    points = random_points(300)
    x = np.concatenate([points[:60], 2.0 * random_points(60, seed=1)])
    distance = np.random.default_rng(2).uniform(0.0, 1.5, len(x))
    found = _kernels.KdTree(points, 1).crowded(x, k, distance)
    np.testing.assert_array_equal(found, reference.crowded(points, x, k, distance))


# --- local fits


def assert_same_fits(found, expected):
    """Compare normals of unknown sign, and what was learned with them, to 1e-9 of the largest."""
    sign = np.sign((found[0] * expected[0]).sum(axis=-1, keepdims=True))
    np.testing.assert_allclose(found[0] * sign, expected[0], rtol=0.0, atol=1e-9)
    for values, right in zip(found[1:], expected[1:], strict=True):
        np.testing.assert_allclose(values, right, rtol=0.0, atol=1e-9 * np.abs(right).max())


@pytest.mark.parametrize("factor", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_fits_of_several_scales(noise, factor):
    points = torus(600).noisy(noise).scaled(factor).points
    centers, scales = points[::20], np.array([8, 18, 40, 1000])
    tree = _kernels.KdTree(points, 1)
    found = _kernels.fit_scales(tree, points, centers, scales)
    assert_same_fits(list(map(np.asarray, found)), reference.fit_scales(points, centers, scales))


@pytest.mark.parametrize("iterations", [0, 3])
@pytest.mark.parametrize(("sided", "stretched"), [(False, False), (True, False), (True, True)])
def test_fits_of_rules(sided, stretched, iterations):
    shape = box(500)
    points, truth = shape.noisy(0.01)
    centers = points[::12] + 0.002
    size = np.arange(8, 8 + len(centers))
    robust = np.linspace(0.0, 0.03, len(centers))
    sides = np.ascontiguousarray(truth[::12]) if sided else None
    normals = truth if sided else None
    tree = _kernels.KdTree(points, 1)
    stretch = np.linspace(1.0, 2.0, len(centers)) if stretched else np.ones(len(centers))
    across = sides[:, [1, 2, 0]] if stretched else None
    options = normals, sides, across, stretch
    found = _kernels.fit_quadrics(tree, points, centers, size, robust, iterations, *options)
    frames, coefficients, *figures = map(np.asarray, found)
    wanted = reference.Wanted(size, robust, sides, across, stretch)
    expected = reference.fit_quadrics(points, centers, wanted, iterations, normals)

    sign = np.sign((frames[:, 2] * expected[0][:, 2]).sum(axis=1))[:, None]
    turned = frames * np.stack([np.ones_like(sign), sign, sign], axis=1)
    np.testing.assert_allclose(turned, expected[0], rtol=0.0, atol=1e-9)
    mirrored = np.where(sign < 0, coefficients * MIRROR, coefficients)
    np.testing.assert_allclose(mirrored, expected[1], rtol=0.0, atol=1e-9)
    for values, right in zip(figures, expected[2:], strict=True):
        np.testing.assert_allclose(values, right, rtol=0.0, atol=1e-9)


def test_frames_are_right_handed_and_orthonormal():
    points = sphere(300).points
    tree = _kernels.KdTree(points, 1)
    sizes, robust = np.full(300, 20), np.zeros(300)
    frames = np.asarray(
        _kernels.fit_quadrics(
            tree, points, points, sizes, robust, 0, None, None, None, np.ones(300)
        )[0]
    )
    np.testing.assert_allclose(
        frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (300, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-12)


def test_fit_recovers_an_exact_quadric():
    rng = np.random.default_rng(0)
    u, v = rng.uniform(-1.0, 1.0, (2, 400))
    points = np.stack([u, v, 0.02 * u * u - 0.01 * u * v + 0.03 * v * v], axis=1)
    tree = _kernels.KdTree(points, 1)
    normals, residual, *_ = _kernels.fit_scales(tree, points, np.zeros((1, 3)), np.array([60]))
    assert abs(normals[0, 0, 2]) > 1.0 - 1e-7
    assert residual[0, 0] < 1e-5


def test_fit_of_points_in_one_place_is_finite():
    points = np.zeros((20, 3))
    tree = _kernels.KdTree(points, 1)
    normals, *figures = _kernels.fit_scales(tree, points, points[:1], np.array([8]))
    assert np.isfinite(normals).all()
    assert np.isfinite(figures).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0)


# --- typical data


def cells_of(points, capacity=40):
    cells = build_octree(points, capacity)
    count = np.diff(cells.offsets)
    clusters = np.clip(np.arange(len(count)) % 7 + 1, 1, count)
    return cells.points, cells.offsets, clusters


@pytest.mark.parametrize(("iterations", "tolerance"), [(8, 1e-2), (1, 0.0), (30, 1e-6)])
def test_typical_data(iterations, tolerance):
    points, offsets, clusters = cells_of(torus(1500).noisy(0.05).points)
    found = _kernels.typical_data(points, offsets, clusters, iterations, tolerance, 2)
    expected = reference.typical_data(points, offsets, clusters, iterations, tolerance)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)


def test_typical_data_is_fuzzy_c_means():
    points = random_points(60)
    found = _kernels.typical_data(points, np.array([0, 60]), np.array([5]), 12, 0.0, 1)
    start = partition_memberships(points, first_centers(points, 5))
    expected = fuzzy_c_means(points, 5, tol=0.0, max_iter=12, memberships=start).centers
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)


def test_as_many_typical_data_as_points_are_the_points():
    points = random_points(9)
    found = _kernels.typical_data(points, np.array([0, 9]), np.array([9]), 8, 1e-2, 1)
    np.testing.assert_array_equal(found, points)


def test_typical_data_of_repeated_points_are_finite():
    points = np.repeat(random_points(2), 10, axis=0)
    args = points, np.array([0, 20]), np.array([4]), 8, 1e-2
    found = np.asarray(_kernels.typical_data(*args, 1))
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found, reference.typical_data(*args), rtol=0.0, atol=1e-12)


# --- threads


@pytest.mark.parametrize("n_threads", [2, 3])
def test_results_do_not_depend_on_the_number_of_threads(n_threads):
    points, normals = torus(3000).noisy(0.01)
    rules = random_rules(1500)
    x = places_near(rules)
    sizes, robust = np.full(len(points), 20), np.full(len(points), 0.02)
    data, normal, unit_rules, *rest = unit_data(points, normals)
    area, mu = np.ones(len(points)), normals / len(points)

    def everything(threads):
        tree, rule_view = _kernels.KdTree(points, threads), view(rules, threads)
        yield from tree.query(x, 9, np.inf)
        yield from _kernels.fit_scales(tree, points, points[::7], np.array([8, 27]))
        yield from _kernels.fit_quadrics(
            *(tree, points, points, sizes, robust, 2, normals, normals, normals[:, [1, 2, 0]]),
            np.linspace(1.0, 2.0, len(points)),
        )
        yield _kernels.typical_data(*cells_of(points), 8, 1e-2, threads)
        yield from _kernels.infer_normals(rule_view, x, None, 12)
        yield from _kernels.reconstruct_units(tree, data, normal, view(unit_rules), *rest)
        yield from _kernels.consequent_errors(rule_view, x, 12)
        yield _kernels.evaluate_field(rule_view, *random_terms(1500), x, 16)
        widths = np.full(len(x), 0.1)
        sources = _kernels.WindingTree(points, area, threads)
        yield sources.winding(mu, x, widths, 0.5)
        yield from sources.gradient(mu, x, widths, 0.5)
        lists = sources.lists(x, 0.5)
        yield sources.adjoint_at(area, lists, widths)

    for one, several in zip(everything(1), everything(n_threads), strict=True):
        assert np.asarray(one).tobytes() == np.asarray(several).tobytes()
