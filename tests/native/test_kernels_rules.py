"""Kernels that infer from rules against their twins."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_data import places_near, random_rules, random_terms, unit_data, view, with_trust
from shapes import box, sphere

from o3d_sofnn import _kernels, reference
from o3d_sofnn.reference.implicit.rlps import basis, quadric_height, unit_points
from o3d_sofnn.reference.sampling.local_fit import frame_of

# --- inference and field


def nearby_runs(rules):
    """Places of which consecutive ones share their nearest rules, as points of a cloud do."""
    offsets = np.random.default_rng(3).normal(0.0, 0.02, (20, 3))
    return (rules.centers[::20, None] + offsets).reshape(-1, 3)


@pytest.mark.parametrize("sided", [False, True])
@pytest.mark.parametrize("places", [places_near, nearby_runs])
@pytest.mark.parametrize("k", [1, 12, 400])
def test_inferred_normals(k, places, sided):
    rules = random_rules()
    x = places(rules)
    sides = np.random.default_rng(4).normal(size=x.shape) if sided else None
    found = _kernels.infer_normals(view(rules), x, sides, k)
    expected = reference.infer_normals(rules, x, sides, k)
    for values, right in zip(found, expected, strict=True):
        np.testing.assert_allclose(values, right, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(found[0], axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("sided", [False, True])
@pytest.mark.parametrize("neurons", [1, 3, 8])
def test_normals_inferred_with_off_line_rules(neurons, sided):
    rules = with_trust(random_rules(), neurons)
    x = places_near(rules)
    sides = np.random.default_rng(4).normal(size=x.shape) if sided else None
    found = _kernels.infer_normals(view(rules), x, sides, 12)
    expected = reference.infer_normals(rules, x, sides, 12)
    for values, right in zip(found, expected, strict=True):
        np.testing.assert_allclose(values, right, rtol=0.0, atol=1e-9)


def test_gates_and_neurons_belong_together():
    rules = with_trust(random_rules())
    for wrong in (rules._replace(gates=None), rules._replace(neurons=None)):
        with pytest.raises(ValueError, match="gates and neurons"):
            view(wrong)
    with pytest.raises(ValueError, match="at most 8"):
        view(with_trust(random_rules(), 9))


@pytest.mark.parametrize("places", [places_near, nearby_runs])
@pytest.mark.parametrize("k", [1, 12, 400])
def test_consequent_errors(k, places):
    rules = random_rules()
    x = places(rules)
    error, share = _kernels.consequent_errors(view(rules), x, k)
    expected_error, expected_share = reference.consequent_errors(rules, x, k)
    np.testing.assert_allclose(share, expected_share, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(error, expected_error, rtol=0.0, atol=1e-8)
    assert np.asarray(share).sum() == pytest.approx(len(x))


def test_inferred_normals_do_not_depend_on_the_other_places():
    rules = random_rules()
    x = nearby_runs(rules)
    together = np.asarray(_kernels.infer_normals(view(rules), x, None, 12)[0])
    order = np.random.default_rng(0).permutation(len(x))
    shuffled = np.ascontiguousarray(x[order])
    apart = np.asarray(_kernels.infer_normals(view(rules), shuffled, None, 12)[0])
    np.testing.assert_allclose(apart, together[order], rtol=0.0, atol=1e-12)


def test_rules_that_cancel_leave_the_best_one():
    frames = np.array([np.eye(3), np.diag([1.0, -1.0, -1.0])])
    rules = reference.Rules(np.zeros((2, 3)), frames, np.zeros((2, 6)), *np.ones((4, 2)))
    normals, *figures = _kernels.infer_normals(view(rules), np.zeros((1, 3)), None, 2)
    assert abs(normals[0, 2]) == 1.0
    assert np.isfinite(figures).all()


def test_normals_far_from_every_rule_are_unit():
    rules = random_rules()
    x = np.array([[1e3, 0.0, 0.0], [0.0, 1e6, 0.0]])
    normals = _kernels.infer_normals(view(rules), x, None, 12)[0]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("k", [1, 16, 60])
def test_field(k):
    rules, terms = random_rules(), random_terms()
    x = places_near(rules)
    values = _kernels.evaluate_field(view(rules), *terms, x, k)
    expected = reference.evaluate_field(rules, *terms, x, k)
    np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-9)


def no_terms(n):
    return np.zeros((n, 13, 4)), np.zeros(n, np.int64)


def corner(convex):
    """Rules on the three planes x, y, z = 0 that bound an octant or what is left without it."""
    grid = np.linspace(0.05, 0.95, 7) * (-1.0 if convex else 1.0)
    a, b = (part.ravel() for part in np.meshgrid(grid, grid))
    zero = np.zeros_like(a)
    centers = np.concatenate([np.stack(p, 1) for p in ((zero, a, b), (a, zero, b), (a, b, zero))])
    frames = np.repeat([frame_of(n) for n in np.eye(3)], len(a), axis=0)
    n = len(centers)
    arrays = np.zeros((n, 6)), np.full(n, 0.3), np.ones(n), np.full(n, 0.01), np.ones(n)
    return reference.Rules(np.ascontiguousarray(centers), np.ascontiguousarray(frames), *arrays)


@pytest.mark.parametrize("convex", [True, False])
def test_field_keeps_edges_sharp(convex):
    rules = corner(convex)
    inner = -0.5 if convex else 0.5
    across = np.random.default_rng(0).uniform(-0.05, 0.05, (200, 2))
    x = np.column_stack([across, np.full(200, inner)])
    terms = no_terms(len(rules.centers))
    values = _kernels.evaluate_field(view(rules), *terms, x, 16)
    exact = across.max(axis=1) if convex else across.min(axis=1)
    np.testing.assert_allclose(values, exact, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("convex", [True, False])
def test_the_odd_edge_of_three_faces_comes_first(convex):
    # A plate with a valley along its upper side, and what is left of space without it.
    slope = 0.8
    normals = np.array([[0.0, 0.0, -1.0], [0.0, -slope, 1.0], [0.0, slope, 1.0]])
    normals *= (1.0 if convex else -1.0) / np.linalg.norm(normals, axis=1, keepdims=True)
    centers = np.array([[0.0, 0.0, -0.1], [0.0, 0.2, 0.16], [0.0, -0.2, 0.16]])
    frames = np.ascontiguousarray([frame_of(normal) for normal in normals])
    rules = reference.Rules(
        centers, frames, np.zeros((3, 6)), *np.ones((2, 3)), np.full(3, 0.01), np.ones(3)
    )
    x = np.random.default_rng(0).uniform(-0.1, 0.1, (200, 3))
    values = _kernels.evaluate_field(view(rules), *no_terms(3), x, 16)
    heights = ((x[:, None] - centers) * normals).sum(axis=2)
    pair = heights[:, 1:].min(axis=1) if convex else heights[:, 1:].max(axis=1)
    exact = np.maximum(heights[:, 0], pair) if convex else np.minimum(heights[:, 0], pair)
    np.testing.assert_allclose(values, exact, rtol=0.0, atol=1e-12)
    expected = reference.evaluate_field(rules, *no_terms(3), x, 16)
    np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-12)


def edge_with_few_rules(bend):
    """Rules on two planes that meet at the edge x = z = 0; the second one has its rules far off."""
    centers = np.array([[-0.1, 0.0, 0.0], [-0.1, 0.5, 0.0], [0.0, 0.0, -1.0]])
    frames = np.ascontiguousarray([frame_of(np.eye(3)[k]) for k in (2, 2, 0)])
    coefficients = np.zeros((3, 6))
    coefficients[2, 3] = bend
    ones = np.ones(3)
    return reference.Rules(centers, frames, coefficients, 0.95 * ones, ones, 0.01 * ones, ones)


@pytest.mark.parametrize(("bend", "cut"), [(0.0, True), (0.2, False)])
def test_a_flat_face_with_few_rules_bounds_the_other_one(bend, cut):
    rules = edge_with_few_rules(bend)
    x = np.array([[0.1, 0.0, -0.01]])
    value = _kernels.evaluate_field(view(rules), *no_terms(3), x, 16)
    assert (value[0] > 0.09) == cut
    expected = reference.evaluate_field(rules, *no_terms(3), x, 16)
    np.testing.assert_allclose(value, expected, rtol=0.0, atol=1e-12)


# --- local progressive surfaces


def reconstruct(data, n_threads):
    points, normals, rules, *rest = data
    tree = _kernels.KdTree(points, n_threads)
    return _kernels.reconstruct_units(tree, points, normals, view(rules), *rest)


@pytest.mark.parametrize("tolerance", [0.0, 0.002, 0.02, 1.0])
def test_local_progressive_surfaces(tolerance):
    data = unit_data(*box(600).noisy(0.005), tolerance)
    found = reconstruct(data, 2)
    rbf, terms, error, worst = map(np.asarray, found)
    expected = reference.reconstruct_units(*data)
    np.testing.assert_array_equal(terms, expected[1])
    np.testing.assert_allclose(rbf, expected[0], rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(error, expected[2], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(worst, expected[3], rtol=0.0, atol=1e-9)
    assert ((error <= tolerance) | (terms == 13)).all()
    if tolerance == 1.0:
        assert (terms == 0).all()


def test_centers_make_the_residual_smaller():
    shape = box(600)
    coarse, fine = (
        np.asarray(reconstruct(data, 1)[2])
        for data in (unit_data(*shape, 1.0), unit_data(*shape, 0.001))
    )
    assert (fine <= coarse + 1e-12).mean() > 0.95
    assert np.median(fine) < 0.5 * np.median(coarse)


@pytest.mark.parametrize("convex", [True, False])
def test_a_face_does_not_cut_off_the_points_of_another(convex):
    # Two faces of an edge; the quadric of the first bends away before the points of the second.
    rng = np.random.default_rng(0)
    inward = -1.0 if convex else 1.0
    first, second = rng.uniform(-0.3, 0.3, (2, 200, 3))
    first[:, 0] = inward * np.abs(first[:, 0])
    first[:, 2], second[:, 0] = 0.0, 0.0
    second[:, 2] = inward * np.abs(second[:, 2])
    points = np.vstack([first, second])
    normals = np.repeat([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], 200, axis=0)
    bent = inward * np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0])
    one = np.ones(1)
    rules = reference.Rules(
        np.array([[inward * 0.1, 0.0, 0.0]]), np.eye(3)[None], bent[None], 0.3 * one, one, one, one
    )
    data = (points, normals, rules, np.array([200]), np.array([200]), 0.001 * one)
    found = reconstruct(data, 1)
    expected = reference.reconstruct_units(*data)
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-7, atol=1e-8)
    unit = unit_points(points, normals, rules, 0, 200, 200)
    edge = unit.local[unit.bound != 0]
    assert set(unit.bound) == {0, 1 if convex else -1}
    height = quadric_height(bent, edge[:, 0], edge[:, 1])
    terms = np.asarray(found[0])[0, : found[1][0]]
    height = height + basis(edge, terms[:, :3]) @ terms[:, 3]
    limit = 0.001 / 0.3 + 1e-4
    assert (-inward * (edge[:, 2] - height) <= limit).all()


def test_units_without_points_on_their_side_keep_the_quadric():
    data = list(unit_data(*sphere(400)))
    data[1] = -data[1]
    rbf, terms, error, worst = reconstruct(data, 1)
    assert not np.asarray(rbf).any()
    assert not np.asarray(terms).any()
    assert not np.asarray(error).any()
    np.testing.assert_array_equal(worst, data[2].centers)
