"""Tree code of winding numbers against direct sums."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import sphere, torus

from o3d_sofnn import _kernels, reference


def sums(tree, mu, charge, x, widths, theta):
    """Winding number, gradient and adjoint of one call each, the winding number of both calls."""
    alone = tree.winding(mu, x, widths, theta)
    winding, gradient = tree.gradient(mu, x, widths, theta)
    np.testing.assert_allclose(alone, winding, rtol=0.0, atol=1e-6 * np.abs(winding).max())
    adjoint = tree.adjoint_at(charge, tree.lists(x, theta), widths)
    return winding, gradient, adjoint


def dipoles(n=1500):
    shape = torus(n)
    rng = np.random.default_rng(2)
    area = rng.uniform(0.5, 1.5, n) * 4.0 * np.pi**2 * 0.4 / n
    x = np.concatenate([shape.points[:200], rng.uniform(-2.0, 2.0, (200, 3))])
    return shape.points, area, area[:, None] * shape.normals, rng.normal(size=n) * area, x


@pytest.mark.parametrize("width", [0.02, 0.3])
def test_winding_sums_without_opening_are_direct_sums(width):
    points, area, mu, charge, x = dipoles()
    widths = np.full(len(x), width)
    found = sums(_kernels.WindingTree(points, area, 2), mu, charge, x, widths, 1e-6)
    expected = reference.evaluate_winding(points, mu, charge, x, widths)
    size = reference.evaluate_winding(points, mu, np.abs(charge), x, widths)
    for values, exact, scale in zip(found, expected, size, strict=True):
        # 1500 single precision terms: inverse roots to 5e-6, sizes are those of the largest.
        np.testing.assert_allclose(values, exact, rtol=0.0, atol=3e-5 * np.abs(scale).max())


@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_winding_tree_error_with_the_opening_angle_of_the_pipeline(offset):
    points, area, mu, charge, x = dipoles()
    # A node is opened for a group of consecutive places: the order says how much is summed.
    x = x[np.asarray(_kernels.WindingTree(x, np.ones(len(x))).order())]
    widths = np.full(len(x), 0.1)
    tree = _kernels.WindingTree(points + offset, area)
    exact = reference.evaluate_winding(points, mu, charge, x, widths)
    errors = []
    for theta in (0.6, 0.3):
        found = sums(tree, mu, charge, x + offset, widths, theta)
        errors.append(
            [
                float(np.abs(np.asarray(a) - b).max() / np.abs(b).max())
                for a, b in zip(found, exact, strict=True)
            ]
        )
    assert max(errors[0]) < 0.03, errors
    # Terms of the first order: half the angle leaves a quarter of the error.
    assert (np.array(errors[1]) < 0.3 * np.array(errors[0])).all(), errors


def test_first_moments_of_a_node_far_away():
    rng = np.random.default_rng(5)
    points, mu, charge = rng.normal(size=(16, 3)), rng.normal(size=(16, 3)), rng.normal(size=16)
    tree, errors = _kernels.WindingTree(points, np.ones(16)), []
    for distance in (7.0, 14.0):
        x, width = distance * np.array([[0.6, 0.0, 0.8]]), np.full(1, 0.1)
        found = sums(tree, mu, charge, x, width, 0.9)
        exact = reference.evaluate_winding(points, mu, charge, x, width)
        errors.append([np.abs(np.asarray(a) - b).max() for a, b in zip(found, exact, strict=True)])
    # What is left out falls off two orders faster than the sum itself: r^-4, r^-5 and r^-4.
    assert (np.array(errors[0]) / errors[1] > [10.0, 20.0, 10.0]).all(), errors


def test_winding_number_of_a_closed_surface():
    points, normals = sphere(4000)
    area = np.full(4000, 4.0 * np.pi / 4000)
    x = np.array([[0.0, 0.0, 0.0], [0.3, -0.2, 0.4], [2.0, 0.0, 0.0], [0.0, 5.0, 5.0]])
    tree = _kernels.WindingTree(points, area)
    winding = tree.winding(area[:, None] * normals, x, np.full(4, 0.05), 0.5)
    np.testing.assert_allclose(winding, [1.0, 1.0, 0.0, 0.0], atol=0.02)


def test_adjoint_is_the_transposed_operator():
    points, _, mu, charge, _ = dipoles(400)
    width = np.full(400, 0.1)
    tree = _kernels.WindingTree(points, np.ones(400))
    winding = np.asarray(tree.winding(mu, points, width, 1e-6))
    adjoint = np.asarray(tree.adjoint_at(charge, tree.lists(points, 1e-6), width))
    assert charge @ winding == pytest.approx(-(adjoint * mu).sum(), rel=1e-4)


@pytest.mark.parametrize("n", [1, 16, 33, 400])
def test_kept_lists_give_the_same_sums(n):
    points, area, mu, charge, x = dipoles(n)
    width = np.random.default_rng(3).uniform(0.05, 0.2, len(x))
    tree = _kernels.WindingTree(points, area)
    lists = tree.lists(x, 0.4)
    for _ in range(2):
        np.testing.assert_array_equal(
            tree.winding_at(mu, lists, width), tree.winding(mu, x, width, 0.4)
        )
        for kept, once in zip(
            tree.gradient_at(mu, lists, width), tree.gradient(mu, x, width, 0.4), strict=True
        ):
            np.testing.assert_array_equal(kept, once)
        np.testing.assert_array_equal(
            tree.adjoint_at(charge, lists, width),
            tree.adjoint_at(charge, tree.lists(x, 0.4), width),
        )


def test_winding_order_is_a_permutation_that_keeps_neighbors_together():
    points = sphere(1000).points
    order = np.asarray(_kernels.WindingTree(points, np.ones(1000)).order())
    np.testing.assert_array_equal(np.sort(order), np.arange(1000))
    step = np.linalg.norm(np.diff(points[order], axis=0), axis=1).mean()
    assert step < 0.5 * np.linalg.norm(np.diff(points, axis=0), axis=1).mean()


@pytest.mark.parametrize("n", [1, 2, 16, 17])
def test_winding_trees_of_few_points(n):
    points = np.random.default_rng(0).normal(size=(n, 3))
    area, width, x = np.ones(n), np.full(3, 0.1), np.random.default_rng(1).normal(size=(3, 3))
    found = sums(_kernels.WindingTree(points, area), points, area, x, width, 0.5)
    expected = reference.evaluate_winding(points, points, area, x, width)
    for values, exact in zip(found, expected, strict=True):
        np.testing.assert_allclose(values, exact, rtol=1e-4, atol=1e-5)
