"""Kernels with odd input: finite numbers give finite numbers, nothing is read out of bounds."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_data import places_near, random_rules, random_terms, unit_data, view, with_trust
from shapes import sphere, torus

from o3d_sofnn import _kernels, reference
from o3d_sofnn.meshing.isosurface.marching_cubes import EDGE_ENDS, NUDGES, both_tables
from o3d_sofnn.reference.sampling.local_fit import Wanted


def lattice(*shape):
    return np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3) * 1.0


# --- finite in, finite out


@pytest.mark.parametrize("turn", [np.eye(3), np.linalg.qr(np.arange(9.0).reshape(3, 3) % 5)[0]])
def test_frames_where_the_narrow_tangent_is_the_normal(turn):
    """All directions of a lattice are alike: the plane of a fit may lie across any tangent."""
    points = np.ascontiguousarray(lattice(5, 5, 5) @ turn)
    centers = points[[0, 31, 62, 124]]
    sizes, robust, stretch = np.full(4, 60), np.full(4, 0.3), np.full(4, 1.7)
    tree = _kernels.KdTree(points, 1)
    for axis in turn:
        normals, sides = np.tile(axis, (125, 1)), np.tile(axis, (4, 1))
        for across in turn:
            options = sides, np.tile(across, (4, 1)), stretch
            found = _kernels.fit_quadrics(
                tree, points, centers, sizes, robust, 3, normals, *options
            )
            wanted = Wanted(sizes, robust, *options)
            expected = reference.fit_quadrics(points, centers, wanted, 3, normals)
            frames = np.asarray(found[0])
            np.testing.assert_allclose(
                frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (4, 1, 1)), atol=1e-12
            )
            assert all(np.isfinite(array).all() for array in found)
            # Radius and support do not depend on which of some equal axes is taken.
            for array, other in zip(found[3:], expected[3:], strict=True):
                np.testing.assert_allclose(array, other, rtol=1e-9)


def test_a_fit_without_any_weight_is_a_plane():
    """All neighbours lie on the narrow axis, beyond the ellipse."""
    points = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    up, across = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])
    size, robust, normals = np.array([2]), np.array([0.1]), np.tile(up, (2, 1))
    options = up, across, np.array([1.9])
    tree, center = _kernels.KdTree(points, 1), np.zeros((1, 3))
    found = _kernels.fit_quadrics(tree, points, center, size, robust, 3, normals, *options)
    expected = reference.fit_quadrics(points, center, Wanted(size, robust, *options), 3, normals)
    for array, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(array, other, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(found[1], 0.0)


def odd_rules(kind):
    rules = random_rules()
    if kind == "one place":
        return rules._replace(centers=np.zeros_like(rules.centers))
    if kind == "no extent":
        return rules._replace(radius=np.where(np.arange(300) % 2, rules.radius, 1e-300))
    if kind == "no tolerance":
        return rules._replace(tolerance=np.zeros(300))
    if kind == "short frames":
        return rules._replace(frames=0.3 * rules.frames)
    if kind == "skew frames":
        frames = rules.frames.copy()
        frames[:, 0] = frames[:, 2]
        return rules._replace(frames=frames)
    if kind == "steep":
        return rules._replace(coefficients=1e12 * rules.coefficients)
    if kind == "no quality":
        return rules._replace(quality=np.zeros(300))
    assert kind == "far places"
    return rules


ODD = [
    *("one place", "no extent", "no tolerance", "short frames", "skew frames", "steep"),
    *("no quality", "far places"),
]


@pytest.mark.parametrize("kind", ODD)
def test_odd_rules_say_something_finite(kind):
    rules = odd_rules(kind)
    terms = random_terms()
    x = places_near(rules) * (1e15 if kind == "far places" else 1.0)
    for trusted in (rules, with_trust(rules)):
        normals, agreement, residual = _kernels.infer_normals(view(trusted), x, None, 12)
        assert np.isfinite(agreement).all()
        assert np.isfinite(residual).all()
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    assert all(np.isfinite(a).all() for a in _kernels.consequent_errors(view(rules), x, 12))
    for k in (1, 3, 16):
        assert np.isfinite(_kernels.evaluate_field(view(rules), *terms, x, k)).all()


@pytest.mark.parametrize("kind", ["no tolerance", "short frames", "no quality"])
def test_odd_rules_are_those_of_the_twins(kind):
    rules, terms = odd_rules(kind), random_terms()
    x = places_near(rules)[::9]
    found = np.asarray(_kernels.evaluate_field(view(rules), *terms, x, 5))
    expected = reference.evaluate_field(rules, *terms, x, 5)
    close = np.isclose(found, expected, rtol=1e-6, atol=1e-9)
    assert close.mean() > 0.97, close.mean()  # equal memberships may tie in another order
    infer = _kernels.infer_normals(view(rules), x, None, 5)
    for array, other in zip(infer, reference.infer_normals(rules, x, None, 5), strict=True):
        assert np.isclose(array, other, rtol=1e-6, atol=1e-9).mean() > 0.97


@pytest.mark.parametrize("radius", [1e-300, 1e-12, 1e12])
def test_units_of_any_size_are_finite(radius):
    points, normals, rules, *rest = unit_data(*torus(900))
    rules = rules._replace(radius=np.full(len(rules.centers), radius))
    tree = _kernels.KdTree(points, 1)
    found = _kernels.reconstruct_units(tree, points, normals, view(rules), *rest)
    assert all(np.isfinite(array).all() for array in found)


@pytest.mark.parametrize("spot", [0.0, 1e-20, 1e-12, 1e-8])
def test_winding_numbers_of_a_dense_spot(spot):
    """Within single precision all of it is one place, whatever the smoothing width."""
    rng = np.random.default_rng(0)
    dense = [0.3, 0.2, 0.1] + spot * rng.normal(size=(500, 3))
    points, normals = sphere(500)
    x = np.concatenate([dense, points])
    mu = np.concatenate([rng.normal(size=(500, 3)), normals])
    charge, width = rng.normal(size=1000), np.full(1000, 1e-30)
    tree = _kernels.WindingTree(x, np.ones(1000))
    # What the iteration of the sides does: the answer to one sum is what the next one adds up.
    winding = np.asarray(tree.winding(mu, x, width, 0.6))
    assert np.isfinite(winding).all()
    downhill = np.asarray(tree.adjoint_at(charge, tree.lists(x, 0.6), width))
    for vectors in (downhill, np.asarray(tree.gradient(mu, x, width, 0.6)[1])):
        assert np.isfinite(vectors).all()
        assert np.isfinite(tree.winding(vectors, x, width, 0.6)).all()
    if spot == 0.0:
        expected = reference.evaluate_winding(x[500:], normals, None, x[500:], width[500:])[0]
        alone = _kernels.WindingTree(points, np.ones(500))
        found = alone.winding(normals, points, width[500:], 1e-6)
        np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())


def test_the_crossing_of_values_that_are_no_numbers_is_on_the_edge():
    nodes = lattice(2, 2, 2)[:, ::-1].copy()
    values = np.array([-1.0, *[np.nan] * 7])
    args = values, nodes, np.arange(8, dtype=np.int32)[None], *both_tables(), EDGE_ENDS, NUDGES
    vertices, triangles, *_ = map(np.asarray, _kernels.marching_cubes(*args))
    np.testing.assert_allclose(np.sort(vertices.sum(axis=1)), NUDGES[0])
    assert len(triangles) == 1
    np.testing.assert_allclose(reference.marching_cubes(*args)[0], vertices)
