"""What the last bit of the data or of the processor changes stays within the bounds of accuracy."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from known_functions import problem

from o3d_sofnn.sofnn.estimator import SOFNN

PERTURBATIONS = 20

CASES = [
    ("chirp 1D", 0.1, "fit", "constant", 0.06),
    ("ridge 2D", 0.0, "fit", "linear", 0.002),
    ("sine 1D", 0.0, "descending", "constant", 0.05),
    ("peak 2D", 0.0, "ascending", "constant", 0.05),
    ("peak 2D", 0.1, "descending", "constant", 0.1),
]


def learned(x, y, how, consequent):
    model = SOFNN(consequent=consequent, max_rules=8 if consequent == "linear" else 200)
    if how == "fit":
        return model.fit(x, y)
    order = np.argsort(x[:, 0] if how == "ascending" else -x[:, 0])
    return model.partial_fit(x[order], y[order])


@pytest.mark.parametrize(("name", "noise", "how", "consequent", "bound"), CASES)
def test_the_last_bits_of_the_data_do_not_decide(name, noise, how, consequent, bound):
    x, y, error = problem(name, noise)
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(PERTURBATIONS):
        moved = x + 1e-13 * rng.normal(size=x.shape), y + 1e-13 * rng.normal(size=y.shape)
        errors.append(error(learned(*moved, how, consequent).predict))
    assert max(errors) < bound


def dispatched(*names):
    """Give the optional processor features that numpy may use here and that bear these names."""
    core = pytest.importorskip("numpy._core._multiarray_umath")
    usable = [feature for feature in core.__cpu_dispatch__ if core.__cpu_features__[feature]]
    return [feature for feature in usable if any(name in feature for name in names)]


@pytest.mark.parametrize("without", [("AVX512", "X86_V4"), ("",)], ids=["AVX2", "baseline"])
def test_processors_with_fewer_features_pass_the_same_bounds(without):
    features = dispatched(*without)
    if not features:
        pytest.skip("numpy uses none of these features here")
    environment = {**os.environ, "NPY_DISABLE_CPU_FEATURES": " ".join(features)}
    tests = Path(__file__).with_name("test_network.py")
    chosen = "(linear and ridge and 1) or (any_order and 0.05 and (sine or peak))"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tests)]
    done = subprocess.run(
        [*command, "-k", chosen], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
