"""The equations inside the network: inference, growth, combination, gradients."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from o3d_sofnn.sofnn.adjustment import (
    Reduced,
    adjust,
    description_length,
    ridge_for,
    solve_consequents,
)
from o3d_sofnn.sofnn.neurons import Neurons, fuzzy_basis, infer, log_firing, offsets, sensitivity
from o3d_sofnn.sofnn.offline import noise_level
from o3d_sofnn.sofnn.structure import combine, generate, merge, nearest_distance, similarity


def some_neurons(seed=0, n_rules=5, d=2, n_outputs=2, n_terms=1):
    rng = np.random.default_rng(seed)
    return Neurons(
        rng.normal(size=(n_rules, d)),
        rng.uniform(0.5, 1.5, (n_rules, d)),
        rng.normal(size=(n_terms, n_rules, n_outputs)),
    )


def test_inference_is_equation_7_written_out():
    neurons = some_neurons()
    for x in np.random.default_rng(1).normal(size=(10, 2)):
        strength = [
            np.prod([np.exp(-((x[i] - c[i]) ** 2) / (2.0 * s[i] ** 2)) for i in range(2)])
            for c, s in zip(neurons.centers, neurons.widths, strict=True)
        ]
        expected = sum(a * y for a, y in zip(strength, neurons.coefficients[0], strict=True)) / sum(
            strength
        )
        np.testing.assert_allclose(infer(x[None], neurons)[0], expected, rtol=1e-12)


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 1000), reach=st.floats(0.0, 300.0))
def test_output_is_a_mean_of_consequents_however_far(seed, reach):
    neurons = some_neurons(seed)
    x = np.random.default_rng(seed).normal(size=(5, 2)) * 10.0**reach
    y = infer(x, neurons)
    assert np.isfinite(y).all()
    assert (y >= neurons.coefficients[0].min(axis=0) - 1e-9).all()
    assert (y <= neurons.coefficients[0].max(axis=0) + 1e-9).all()


def premises(neurons):
    """Centres in widths, then logarithms of the widths: what is adjusted."""
    return np.concatenate(
        [(neurons.centers / neurons.widths).ravel(), np.log(neurons.widths).ravel()]
    )


def with_premises(neurons, values):
    centers, log_widths = values.reshape(2, *neurons.centers.shape)
    return Neurons(centers * neurons.widths, np.exp(log_widths), neurons.coefficients)


def differences(function, neurons, step):
    """Central differences of a function of the rules by their premises, one column each."""
    at, columns = premises(neurons), []
    for index in range(len(at)):
        ends = []
        for sign in (1.0, -1.0):
            moved = at.copy()
            moved[index] += sign * step
            ends.append(function(with_premises(neurons, moved)))
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    return np.stack(columns, axis=-1)


@pytest.mark.parametrize("n_terms", [1, 3])
def test_sensitivity_equals_finite_differences(n_terms):
    neurons = some_neurons(2, n_terms=n_terms)
    x = np.random.default_rng(3).normal(size=(20, 2))
    u = offsets(x, neurons.centers, neurons.widths)
    numeric = differences(lambda rules: infer(x, rules), neurons, 1e-6)
    for k in range(2):
        ours = sensitivity(u, fuzzy_basis(log_firing(u)), neurons.coefficients[:, :, k])
        np.testing.assert_allclose(ours, numeric[:, k], rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("n_terms", [1, 3])
def test_reduced_gradient_equals_finite_differences(n_terms):
    neurons = some_neurons(4, n_terms=n_terms)
    rng = np.random.default_rng(5)
    x, y = rng.normal(size=(60, 2)), rng.normal(size=(60, 2))
    slope = Reduced.of(neurons, x, y, 1e-9).derivatives()[1]
    numeric = differences(lambda rules: Reduced.of(rules, x, y, 1e-9).error, neurons, 1e-5)
    np.testing.assert_allclose(slope, numeric, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("n_rows", [20, 200])  # fewer rows than premises, and more
@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_adjustment_lowers_the_error_with_every_step(noise, n_rows):
    rng = np.random.default_rng(6)
    x = rng.uniform(-1, 1, (n_rows, 2))
    y = np.sin(3 * x[:, :1]) * x[:, 1:] + noise * rng.normal(size=(n_rows, 1))
    start = some_neurons(7, n_rules=8, n_outputs=1)
    ridge = ridge_for(n_rows, noise)
    errors = [
        Reduced.of(adjust(start, x, y, noise, steps), x, y, ridge).error for steps in range(8)
    ]
    if noise == 0.0:  # with noise steps have a price
        assert (np.diff(errors) <= 0.0).all()
    assert errors[-1] < (0.5 if noise == 0.0 else 0.95) * errors[0]


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 1000), noise=st.sampled_from([0.0, 0.3]))
def test_adjustment_is_bounded(seed, noise):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-1, 1, (60, 2)), rng.normal(size=(60, 2))
    start = some_neurons(seed)
    after = adjust(start, x, y, noise, 20)
    ratio = after.widths / start.widths
    assert (ratio <= 4.0 + 1e-9).all()
    assert (ratio >= 0.25 - 1e-9).all()
    assert (after.centers >= x.min(axis=0) - 1e-9).all()
    assert (after.centers <= x.max(axis=0) + 1e-9).all()


def test_new_neuron_is_equation_10():
    neurons = some_neurons(8)
    x, y = np.array([3.0, -2.0]), np.array([5.0, 6.0])
    d_min = min(np.linalg.norm(neurons.centers - x, axis=1))
    assert nearest_distance(x[None], neurons.centers)[0] == pytest.approx(d_min)
    grown = generate(neurons, x, y, d_min, 1.1)
    assert len(grown) == len(neurons) + 1
    np.testing.assert_array_equal(grown.centers[-1], x)
    np.testing.assert_allclose(grown.widths[-1], 1.1 * d_min)
    np.testing.assert_array_equal(grown.coefficients[0, -1], y)
    np.testing.assert_array_equal(grown.centers[:-1], neurons.centers)


def test_similarity_is_the_cosine_between_membership_functions():
    neurons = some_neurons(9, d=1)
    t = np.linspace(-30, 30, 200_001)
    functions = np.exp(-0.5 * ((t - neurons.centers) / neurons.widths) ** 2)
    norms = np.linalg.norm(functions, axis=1)
    expected = functions @ functions.T / np.outer(norms, norms)
    np.testing.assert_allclose(similarity(neurons), expected, atol=1e-9)


def test_merging_weighs_by_evidence():
    neurons = some_neurons(10)
    merged, weights = merge(neurons, np.array([3.0, 1.0, 1.0, 1.0, 1.0]), 0, 2)
    assert len(merged) == 4
    assert weights.sum() == 7.0
    np.testing.assert_allclose(
        merged.centers[0], 0.75 * neurons.centers[0] + 0.25 * neurons.centers[2]
    )


def test_combination_reduces_the_rules_and_describes_the_data_no_worse():
    rng = np.random.default_rng(12)
    x = rng.uniform(-1, 1, (300, 1))
    y = np.sin(4 * x) + 0.1 * rng.normal(size=x.shape)
    grid = np.repeat(np.linspace(-1, 1, 6), 2)[:, None]
    doubled = Neurons(grid, np.full((12, 1), 0.4), np.zeros((1, 12, 1)))
    doubled = solve_consequents(doubled, x, y, 0.1)
    left, weights = combine(doubled, np.ones(12), 0.99, (x, y), 0.1, 1e-3)
    assert len(left) == 6
    np.testing.assert_allclose(weights, 2.0)
    before, after = (description_length(n, x, y, 1e-3) for n in (doubled, left))
    assert after < before
    assert np.sqrt(np.mean((infer(x, left) - np.sin(4 * x)) ** 2)) < 0.05


def test_combination_spares_a_steep_edge():
    x = np.linspace(-1, 1, 400)[:, None]
    y = np.tanh(30 * x)
    # Two wide neurons side by side whose ratio is a steep sigmoid: similar, but both needed.
    pair = Neurons(np.array([[-0.3], [0.3]]), np.full((2, 1), 0.15), np.zeros((1, 2, 1)))
    wide = solve_consequents(pair, x, y)
    left, _ = combine(wide, np.ones(2), 0.0, (x, y), 0.0, 1e-3)
    assert len(left) == 2


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("noise", [0.0, 0.05, 0.3])
def test_noise_level_is_measured(d, noise):
    rng = np.random.default_rng(11)
    x = rng.uniform(-1, 1, (3000, d))
    y = np.sin(2 * x).sum(axis=1, keepdims=True) + noise * rng.normal(size=(3000, 1))
    assert noise_level(x, y) == pytest.approx(noise, rel=0.15, abs=0.03)
