"""SOFNN as a regressor: known functions, order of arrival, a plain normalised RBF as the bar."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from known_functions import ALL, SMOOTH, UNEVEN, plain_rbf, problem

from o3d_sofnn.sofnn.estimator import SOFNN


@pytest.mark.parametrize(("noise", "bound"), [(0.0, 0.02), (0.1, 0.06)])
@pytest.mark.parametrize("name", ALL)
def test_learns_known_functions(name, noise, bound):
    x, y, error = problem(name, noise)
    assert error(SOFNN().fit(x, y).predict) < bound


@pytest.mark.parametrize("name", SMOOTH)
def test_is_no_worse_than_a_plain_rbf_on_smooth_functions(name):
    x, y, error = problem(name)
    model = SOFNN().fit(x, y)
    assert error(model.predict) <= error(plain_rbf(x, y, model.n_rules_))


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("name", UNEVEN)
def test_beats_a_plain_rbf_several_times_on_uneven_detail(name, noise):
    x, y, error = problem(name, noise)
    model = SOFNN().fit(x, y)
    share = 0.1 if noise == 0.0 else 0.3
    assert error(model.predict) <= share * error(plain_rbf(x, y, model.n_rules_))


def test_rules_gather_where_the_detail_is():
    x, y, _ = problem("chirp 1D")
    centers = SOFNN().fit(x, y).centers_[:, 0]
    assert np.sum(centers < -0.5) > np.sum(centers > 0.0)


def test_noise_does_not_buy_rules():
    clean, noisy = (SOFNN().fit(*problem("ridge 2D", noise)[:2]).n_rules_ for noise in (0.0, 0.3))
    assert noisy < clean


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", ["ridge 2D", "saddle 3D"])
def test_linear_consequents_have_less_error_with_as_few_rules(name, seed):
    x, y, error = problem(name, seed=seed)
    constant, linear = (
        SOFNN(consequent=kind, max_rules=8).fit(x, y) for kind in ("constant", "linear")
    )
    assert linear.n_rules_ <= constant.n_rules_
    assert error(linear.predict) < 0.002
    assert error(linear.predict) <= 0.7 * error(constant.predict)


ORDERS = {
    "random": lambda x: np.random.default_rng(5).permutation(len(x)),
    "ascending": lambda x: np.argsort(x[:, 0]),
    "descending": lambda x: np.argsort(-x[:, 0]),
    "inside out": lambda x: np.argsort(np.sum(x**2, axis=1)),
}


@pytest.mark.parametrize(("noise", "bound"), [(0.0, 0.05), (0.1, 0.1)])
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("name", ["sine 1D", "waves 2D", "peak 2D", "saddle 3D"])
def test_online_learning_in_any_order(name, order, noise, bound):
    x, y, error = problem(name, noise)
    order = ORDERS[order](x)
    model = SOFNN().partial_fit(x[order], y[order])
    assert error(model.predict) < bound
    assert model.n_rules_ <= 200


def test_one_observation_per_call_is_the_same_as_many():
    x, y, _ = problem("sine 1D")
    many = SOFNN().partial_fit(x[:150], y[:150])
    single = SOFNN()
    for row in range(150):
        single.partial_fit(x[row : row + 1], y[row : row + 1])
    np.testing.assert_array_equal(single.predict(x), many.predict(x))


def test_online_adapts_an_offline_model_to_a_new_region():
    x, y, error = problem("sine 1D")
    seen = x[:, 0] < 0
    model = SOFNN().fit(x[seen], y[seen])
    before = error(model.predict)
    model.partial_fit(x[~seen], y[~seen])
    assert error(model.predict) < 0.1 * before


def test_growth_on_line_follows_equation_10():
    model = SOFNN().partial_fit([[0.0, 0.0]], [0.0])
    assert model.n_rules_ == 1
    model.partial_fit([[3.0, 4.0]], [10.0])
    assert model.n_rules_ == 2
    # Two observations lie one standard deviation either side of the mean in every input.
    scale = np.array([1.5, 2.0])
    np.testing.assert_allclose(model.widths_[1], 1.1 * np.sqrt(8.0) * scale)
    np.testing.assert_allclose(model.centers_[1], [3.0, 4.0])


def test_no_growth_within_tolerance_or_boundary():
    x = np.linspace(0, 1, 50)[:, None]
    assert SOFNN().partial_fit(x, np.full(50, 3.0)).n_rules_ == 1
    x, y, _ = problem("sine 1D")
    assert SOFNN(boundary=100.0).partial_fit(x, y).n_rules_ == 1


def test_max_rules_is_kept():
    x, y, _ = problem("ridge 2D")
    assert SOFNN(max_rules=7).fit(x, y).n_rules_ <= 7
    assert SOFNN(max_rules=7).partial_fit(x[:300], y[:300]).n_rules_ <= 7


def test_several_outputs():
    x, y, _ = problem("waves 2D")
    both = np.column_stack([y, 100.0 - 3.0 * y])
    model = SOFNN().fit(x, both)
    assert model.predict(x).shape == both.shape
    assert model.score(x, both) > 0.999
    assert model.theta_.shape == (2, model.n_rules_)


@pytest.mark.parametrize("learn", ["fit", "partial_fit"])
def test_units_and_offsets_do_not_matter(learn):
    x, y, _ = problem("waves 2D")
    x, y = x[:400], y[:400]
    plain = getattr(SOFNN(), learn)(x, y)
    moved = getattr(SOFNN(), learn)(x * 512.0 + [4e5, 5e6], y * 1e-3)
    assert moved.score(x * 512.0 + [4e5, 5e6], y * 1e-3) > 0.99
    assert plain.score(x, y) > 0.99


def test_prediction_is_defined_everywhere_and_in_chunks(monkeypatch):
    x, y, _ = problem("peak 2D")
    model = SOFNN().fit(x, y)
    far = np.array([[1e3, 0.0], [-1e12, 1e12], [1e300, -1e300], [np.finfo(float).max, 0.0]])
    assert np.isfinite(model.predict(far)).all()
    np.testing.assert_array_equal(model.support(far), 0.0)
    assert model.support(model.centers_).max() == 1.0
    whole = model.predict(x)
    monkeypatch.setattr("o3d_sofnn.sofnn.fuzzy_c_means.CHUNK_ELEMENTS", 100)
    np.testing.assert_allclose(model.predict(x), whole, atol=1e-10)


@pytest.mark.parametrize("learn", ["fit", "partial_fit"])
def test_deterministic(learn):
    x, y, _ = problem("peak 2D", noise=0.1)
    first, second = (getattr(SOFNN(), learn)(x[:500], y[:500]) for _ in range(2))
    np.testing.assert_array_equal(first.predict(x), second.predict(x))
    again = pickle.loads(pickle.dumps(first))
    np.testing.assert_array_equal(again.predict(x), first.predict(x))


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_very_few_rows(n):
    x = np.arange(n, dtype=float)[:, None]
    for model in (SOFNN().fit(x, x[:, 0]), SOFNN().partial_fit(x, x[:, 0])):
        assert np.isfinite(model.predict([[0.5], [1e6]])).all()


def test_equal_rows_with_different_outputs_are_averaged():
    x = np.repeat([[0.0], [1.0]], 100, axis=0)
    y = np.where(x[:, 0] == 0.0, 1.0, 5.0) + np.tile([0.5, -0.5], 100)
    np.testing.assert_allclose(SOFNN().fit(x, y).predict([[0.0], [1.0]]), [1.0, 5.0], atol=0.1)


def test_constant_output_and_constant_input():
    x, _, _ = problem("waves 2D")
    np.testing.assert_allclose(SOFNN().fit(x, np.full(len(x), 7.0)).predict(x), 7.0)
    x[:, 1] = 2.0
    y = np.sin(3 * x[:, 0])
    assert SOFNN().fit(x, y).score(x, y) > 0.999
