"""Functions with a known truth, samples of them, and the plain network to compare with."""

from __future__ import annotations

import numpy as np

from o3d_sofnn.sofnn.adjustment import solve_consequents
from o3d_sofnn.sofnn.neurons import Neurons, infer


def peak(x, at, width):
    return 0.3 * x[:, 0] + np.exp(-np.sum((x - at) ** 2, axis=1) / width)


SMOOTH = {
    "sine 1D": (1, lambda x: np.sin(6 * x[:, 0])),
    "waves 2D": (2, lambda x: np.sin(3 * x[:, 0]) * np.cos(2 * x[:, 1])),
    "saddle 3D": (3, lambda x: np.sin(2 * x[:, 0]) + x[:, 1] * x[:, 2]),
}
UNEVEN = {
    "chirp 1D": (1, lambda x: np.sin(1.0 / (0.06 + (x[:, 0] + 1) / 2))),
    "step 1D": (1, lambda x: np.tanh(20 * (x[:, 0] - 0.3)) + 0.3 * x[:, 0]),
    "peak 2D": (2, lambda x: peak(x, [0.5, 0.4], 0.01)),
    "ridge 2D": (2, lambda x: np.tanh(8 * (x[:, 0] + 0.5 * x[:, 1] ** 2 - 0.2))),
    "peak 3D": (3, lambda x: peak(x, [0.5, 0.4, 0.0], 0.05)),
}
ALL = {**SMOOTH, **UNEVEN}
ROWS = {1: 500, 2: 1500, 3: 4000}


def problem(name, noise=0.0, seed=1):
    d, function = ALL[name]
    rng = np.random.default_rng(seed)
    x = rng.uniform(-1, 1, (ROWS[d], d))
    y = function(x)
    y = y + noise * y.std() * rng.normal(size=len(x))
    return x, y, lambda predict: relative_error(predict, d, function)


def relative_error(predict, d, function):
    """Root-mean-square error on fresh points, in standard deviations of the function."""
    q = np.random.default_rng(99).uniform(-1, 1, (3000, d))
    truth = function(q)
    return np.sqrt(np.mean((predict(q) - truth) ** 2)) / truth.std()


def plain_rbf(x, y, n_rules):
    """Fit a normalised RBF of at least `n_rules` equal neurons on a uniform grid."""
    d = x.shape[1]
    n = int(np.ceil(n_rules ** (1 / d) - 1e-9))
    axes = [np.linspace(low, high, n) for low, high in zip(x.min(0), x.max(0), strict=True)]
    centers = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, d)
    spacing = np.ptp(x, axis=0) / max(n - 1, 1)
    grid = Neurons(centers, np.tile(1.1 * spacing, (len(centers), 1)), np.zeros((1, n**d, 1)))
    solved = solve_consequents(grid, x, y[:, None])
    return lambda q: infer(q, solved)[:, 0]
