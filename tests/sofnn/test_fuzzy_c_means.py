"""Fuzzy c-means: against scikit-fuzzy, against the equations, and on hard input."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from o3d_sofnn.sofnn import fuzzy_c_means as clustering
from o3d_sofnn.sofnn.fuzzy_c_means import fuzzy_c_means, partition_memberships

seeds = st.integers(0, 10_000)


def blobs(seed, n=120, d=2, k=4):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(k, d))[rng.integers(k, size=n)] * 3.0 + rng.normal(size=(n, d)) * 0.4


def random_memberships(seed, n, c):
    u = np.random.default_rng(seed).random((n, c))
    return u / u.sum(axis=1, keepdims=True)


@pytest.mark.parametrize("m", [1.3, 2.0, 3.0])
@pytest.mark.parametrize("d", [1, 2, 5])
@pytest.mark.parametrize("iterations", [1, 7, 40])
def test_equals_scikit_fuzzy_from_the_same_memberships(m, d, iterations):
    skfuzzy = pytest.importorskip("skfuzzy")
    x = blobs(3, d=d)
    u = random_memberships(4, len(x), 4)
    centers, theirs, *_ = skfuzzy.cluster.cmeans(
        x.T, 4, m, error=1e-300, maxiter=iterations, init=u.T.copy()
    )
    ours = fuzzy_c_means(x, 4, m=m, tol=0.0, max_iter=iterations, memberships=u)
    assert ours.n_iter == iterations
    np.testing.assert_allclose(ours.centers, centers, atol=1e-9)
    np.testing.assert_allclose(ours.memberships, theirs.T, atol=1e-9)


def test_metric_equals_clustering_transformed_data():
    x = blobs(1, d=3)
    root = np.array([[1.0, 0.0, 0.0], [0.5, 2.0, 0.0], [-0.3, 0.1, 0.4]])
    u = random_memberships(2, len(x), 3)
    with_metric = fuzzy_c_means(x, 3, metric=root @ root.T, memberships=u)
    transformed = fuzzy_c_means(x @ root, 3, memberships=u)
    np.testing.assert_allclose(with_metric.centers @ root, transformed.centers, atol=1e-9)
    np.testing.assert_allclose(with_metric.memberships, transformed.memberships, atol=1e-9)
    np.testing.assert_allclose(with_metric.objective, transformed.objective, rtol=1e-9)


@settings(deadline=None, max_examples=40)
@given(seed=seeds, c=st.integers(2, 7), d=st.integers(1, 4), m=st.floats(1.05, 4.0))
def test_rows_sum_to_one_and_the_objective_never_increases(seed, c, d, m):
    result = fuzzy_c_means(blobs(seed, d=d), c, m=m, random_state=seed, max_iter=60)
    np.testing.assert_allclose(result.memberships.sum(axis=1), 1.0, atol=1e-12)
    assert (result.memberships >= 0.0).all()
    assert result.objective.shape == (result.n_iter,)
    assert (np.diff(result.objective) <= 1e-9 * result.objective[0]).all()


def test_objective_is_equation_1():
    x = blobs(0)
    result = fuzzy_c_means(x, 4, m=1.7)
    d2 = np.sum((x[:, None] - result.centers) ** 2, axis=2)
    assert result.objective[-1] == pytest.approx(np.sum(result.memberships**1.7 * d2))


def test_stops_at_the_first_change_below_the_tolerance():
    x, u = blobs(5), random_memberships(6, 120, 4)
    result = fuzzy_c_means(x, 4, tol=1e-4, memberships=u)
    before, after, last = (
        fuzzy_c_means(x, 4, tol=0.0, max_iter=result.n_iter - k, memberships=u).memberships
        for k in (2, 1, 0)
    )
    assert result.converged
    assert np.abs(last - after).max() < 1e-4 <= np.abs(after - before).max()
    assert not fuzzy_c_means(x, 4, tol=1e-4, max_iter=2, memberships=u).converged


def test_a_row_on_a_center_belongs_to_it_alone():
    centers = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 5.0]])
    u = partition_memberships(np.array([[1.0, 0.0], [0.5, 0.0]]), centers)
    np.testing.assert_array_equal(u[0], [0.0, 1.0, 0.0])
    assert u[1, 0] == u[1, 1] > u[1, 2] > 0.0


def test_a_row_on_several_centers_is_shared_equally():
    centers = np.array([[1.0], [1.0], [3.0]])
    np.testing.assert_array_equal(
        partition_memberships(np.array([[1.0]]), centers)[0], [0.5, 0.5, 0]
    )


@pytest.mark.parametrize("distinct", [1, 2, 3])
def test_fewer_distinct_rows_than_centers(distinct):
    x = np.repeat(np.arange(distinct, dtype=float), 10)[:, None]
    result = fuzzy_c_means(x, 4)
    assert np.isfinite(result.centers).all()
    np.testing.assert_allclose(result.memberships.sum(axis=1), 1.0)
    assert result.objective[-1] == pytest.approx(0.0, abs=1e-6)


@settings(deadline=None, max_examples=25)
@given(seed=seeds)
def test_permutation_of_rows(seed):
    x, u = blobs(seed), random_memberships(seed, 120, 3)
    order = np.random.default_rng(seed).permutation(len(x))
    plain = fuzzy_c_means(x, 3, tol=0.0, max_iter=20, memberships=u)
    moved = fuzzy_c_means(x[order], 3, tol=0.0, max_iter=20, memberships=u[order])
    np.testing.assert_allclose(moved.centers, plain.centers, atol=1e-8)
    np.testing.assert_allclose(moved.memberships, plain.memberships[order], atol=1e-8)


@settings(deadline=None, max_examples=25)
@given(seed=seeds, scale=st.floats(1e-3, 1e3), shift=st.floats(-1e3, 1e3))
def test_rotation_translation_and_scale(seed, scale, shift):
    x, u = blobs(seed, d=3), random_memberships(seed, 120, 3)
    rotation, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    plain = fuzzy_c_means(x, 3, tol=0.0, max_iter=20, memberships=u)
    moved = fuzzy_c_means(scale * (x @ rotation + shift), 3, tol=0.0, max_iter=20, memberships=u)
    expected = scale * (plain.centers @ rotation + shift)
    np.testing.assert_allclose(moved.centers, expected, atol=1e-7 * scale * (1.0 + abs(shift)))
    np.testing.assert_allclose(moved.memberships, plain.memberships, atol=1e-6)
    np.testing.assert_allclose(moved.objective, plain.objective * scale**2, rtol=1e-6)


@pytest.mark.parametrize("scale", [1e-200, 1e200])
def test_extreme_units(scale):
    x, u = blobs(8), random_memberships(8, 120, 3)
    plain = fuzzy_c_means(x, 3, memberships=u)
    tiny = fuzzy_c_means(x * scale, 3, memberships=u)
    np.testing.assert_allclose(tiny.memberships, plain.memberships, atol=1e-9)


def test_far_from_the_origin():
    x, u = blobs(9), random_memberships(9, 120, 3)
    plain = fuzzy_c_means(x, 3, memberships=u)
    far = fuzzy_c_means(x + 5e6, 3, memberships=u)
    np.testing.assert_allclose(far.centers - 5e6, plain.centers, atol=1e-6)


def test_chunks_do_not_change_the_result(monkeypatch):
    x = blobs(10)
    whole = fuzzy_c_means(x, 4)
    monkeypatch.setattr(clustering, "CHUNK_ELEMENTS", 50)
    pieces = fuzzy_c_means(x, 4)
    np.testing.assert_allclose(pieces.memberships, whole.memberships, atol=1e-9)


def test_deterministic_and_leaves_its_input_alone():
    x, u = blobs(11), random_memberships(11, 120, 3)
    kept_x, kept_u = x.copy(), u.copy()
    first, second = fuzzy_c_means(x, 3), fuzzy_c_means(x, 3)
    fuzzy_c_means(x, 3, memberships=u)
    np.testing.assert_array_equal(first.memberships, second.memberships)
    np.testing.assert_array_equal(x, kept_x)
    np.testing.assert_array_equal(u, kept_u)
    other = fuzzy_c_means(x, 3, random_state=1, max_iter=1)
    assert not np.array_equal(other.memberships, fuzzy_c_means(x, 3, max_iter=1).memberships)


@pytest.mark.parametrize(
    ("argument", "changes"),
    [
        ("x", {"x": np.zeros(5)}),
        ("x", {"x": np.zeros((5, 0))}),
        ("x", {"x": np.full((5, 2), np.nan)}),
        ("n_clusters", {"n_clusters": 1}),
        ("n_clusters", {"n_clusters": 20}),
        ("n_clusters", {"n_clusters": 2.5}),
        ("m", {"m": 1.0}),
        ("m", {"m": np.inf}),
        ("tol", {"tol": -1.0}),
        ("max_iter", {"max_iter": 0}),
        ("metric", {"metric": np.eye(3)}),
        ("metric", {"metric": [[1.0, 0.5], [0.0, 1.0]]}),
        ("metric", {"metric": [[1.0, 2.0], [2.0, 1.0]]}),
        ("memberships", {"memberships": np.ones((20, 2))}),
        ("memberships", {"memberships": np.full((20, 3), 1 / 3)}),
        ("memberships", {"memberships": np.tile([1.5, -0.5], (20, 1))}),
        ("memberships", {"memberships": np.tile([1.0, 0.0], (20, 1))}),
    ],
)
def test_bad_input_is_named(argument, changes):
    good = {"x": blobs(0, n=20), "n_clusters": 2}
    with pytest.raises(ValueError, match=rf"^{argument}: expected .*got"):
        fuzzy_c_means(**{**good, **changes})
