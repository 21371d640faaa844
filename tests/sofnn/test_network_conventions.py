"""SOFNN as a scikit-learn estimator: texts, bad input, check_estimator, column names."""

from __future__ import annotations

import numpy as np
import pytest
from known_functions import problem

from o3d_sofnn.sofnn.estimator import SOFNN


def test_rules_are_readable():
    x, y, _ = problem("waves 2D")
    model = SOFNN().fit(x, y)
    assert len(model.rules_) == model.n_rules_
    first = model.rules_[0]
    c, w, value = model.centers_[0], model.widths_[0], model.theta_[0, 0]
    assert first == (
        f"IF x0 is about {c[0]:.4g} (± {w[0]:.2g}) AND x1 is about {c[1]:.4g} (± {w[1]:.2g}) "
        f"THEN y is {value:.4g}"
    )
    sloped = SOFNN(consequent="linear").fit(x, y)
    assert "(x0 " in sloped.rules_[0]
    assert sloped.slopes_.shape == (1, sloped.n_rules_, 2)
    assert model.slopes_ is None


def test_printing_shows_changed_parameters():
    assert str(SOFNN()) == "SOFNN()"
    assert repr(SOFNN(tolerance=0.1, consequent="linear")) == (
        "SOFNN(tolerance=0.1, consequent='linear')"
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("tolerance", 0.0),
        ("tolerance", "small"),
        ("boundary", -1.0),
        ("overlap", 1.0),
        ("overlap", 1.3),
        ("similarity", 1.1),
        ("fuzziness", 1.0),
        ("n_typical", 1),
        ("max_rules", 0),
        ("adjust_steps", 1.5),
        ("memory", 5),
        ("consequent", "cubic"),
    ],
)
@pytest.mark.parametrize("learn", ["fit", "partial_fit"])
def test_bad_parameters_are_named(name, value, learn):
    model = SOFNN(**{name: value})
    with pytest.raises(ValueError, match=rf"^{name}: expected .*got"):
        getattr(model, learn)([[0.0], [1.0]], [0.0, 1.0])
    with pytest.raises(ValueError, match="not fitted"):
        model.predict([[0.0]])


@pytest.mark.parametrize(
    ("x", "y", "name"),
    [
        ([0.0, 1.0], [0.0, 1.0], "X"),
        ([[np.nan]], [0.0], "X"),
        ([["a"]], [0.0], "X"),
        ([[0.0]], [np.inf], "y"),
        ([[0.0]], [0.0, 1.0], "y"),
        ([[0.0]], 0.0, "y"),
        ([[0.0]], None, "y"),
        ([[0.0]], np.zeros((1, 0)), "y"),
    ],
)
def test_bad_data_are_named(x, y, name):
    with pytest.raises(ValueError, match=rf"^{name}: "):
        SOFNN().fit(x, y)
    with pytest.raises(ValueError, match=rf"^{name}: "):
        SOFNN().partial_fit(x, y)


def test_later_data_must_match():
    model = SOFNN().partial_fit([[0.0, 1.0]], [0.0])
    with pytest.raises(ValueError, match="3 features"):
        model.partial_fit([[0.0, 1.0, 2.0]], [0.0])
    with pytest.raises(ValueError, match=r"^y: expected 1 columns"):
        model.partial_fit([[0.0, 1.0]], [[0.0, 1.0]])
    with pytest.raises(ValueError, match=r"^depth: expected a parameter"):
        model.set_params(depth=3)


# Checks of scikit-learn that need what the test environment may not have. None is accepted as
# failed; a check may be skipped for the reason given here.
SKIPPED = {
    "check_array_api_input": "array API dispatch is off; the model computes in numpy",
    "check_regressor_data_not_an_array": "its last part needs pandas",
    "check_dataframe_column_names_consistency": "needs pandas",
}


def test_scikit_learn_accepts_the_estimator():
    checks = pytest.importorskip("sklearn.utils.estimator_checks")
    results = checks.check_estimator(SOFNN(), on_fail=None, on_skip=None)
    failed = {r["check_name"]: repr(r["exception"]) for r in results if r["status"] == "failed"}
    assert failed == {}
    assert {r["check_name"] for r in results if r["status"] == "skipped"} <= set(SKIPPED)
    assert len(results) > 40


def test_works_in_scikit_learn_tools():
    pytest.importorskip("sklearn")
    from sklearn.model_selection import GridSearchCV
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    x, y, _ = problem("sine 1D")
    grid = GridSearchCV(SOFNN(), {"tolerance": [0.05, 0.5]}, cv=3).fit(x, y)
    assert grid.best_params_ == {"tolerance": 0.05}
    assert make_pipeline(StandardScaler(), SOFNN()).fit(x, y).score(x, y) > 0.999


class Frame:
    """The part of a data frame the model looks at."""

    def __init__(self, values, columns):
        self.values, self.columns = np.asarray(values), columns

    def __array__(self, dtype=None, copy=None):
        return self.values.astype(dtype or float)


def test_column_names_are_used_and_compared():
    x, y, _ = problem("waves 2D")
    model = SOFNN().fit(Frame(x, ["east", "north"]), y)
    assert model.rules_[0].startswith("IF east is about")
    with pytest.raises(ValueError, match="same order"):
        model.predict(Frame(x, ["north", "east"]))
    with pytest.raises(ValueError, match=r"unseen at fit time:\n- up"):
        model.predict(Frame(x, ["east", "up"]))
    with pytest.warns(UserWarning, match="does not have valid feature names"):
        model.predict(x)
    with pytest.warns(UserWarning, match="fitted without feature names"):
        SOFNN().fit(x, y).predict(Frame(x, ["east", "north"]))
