"""Adjustment of the parameters of the rules by the gradient of the squared error (section 3.2)."""

from __future__ import annotations

import numpy as np

from o3d_sofnn.sofnn.fuzzy_c_means import row_chunks
from o3d_sofnn.sofnn.neurons import (
    Array,
    Gradient,
    Neurons,
    design,
    fuzzy_basis,
    gradient,
    infer,
    log_firing,
    offsets,
)

# One adjustment may change a width by this factor at most; larger steps leave narrow gaps in
# which a network that fits every sample is free to do anything.
_WIDTH_RANGE = 4.0


# Expected standard deviation of an adjustment, in widths (centres) and log units (widths).
_EXPECTED_STEP = 0.3


# Share of the noise variance taken as ridge: unit outputs, consequents of a few units.
_NOISE_RIDGE = 0.1


# Ridge per sample without noise: keeps consequents in the range of a few outputs, so that
# rules can be read, at the price of a relative error far below any tolerance.
_CLEAN_RIDGE = 1e-8


def ridge_for(n_rows: int, noise: float) -> float:
    """Give the weight of the squared consequents for `n_rows` of standardised data."""
    return _CLEAN_RIDGE * n_rows + _NOISE_RIDGE * noise**2


def normal_equations(neurons: Neurons, x: Array, y: Array) -> tuple[Array, Array]:
    """Give the (pM, pM) and (pM, m) sides of the least-squares problem of the consequents."""
    n_terms, n_rules, n_outputs = neurons.coefficients.shape
    gram = np.zeros((n_terms * n_rules, n_terms * n_rules))
    moment = np.zeros((n_terms * n_rules, n_outputs))
    for rows in row_chunks(len(x), n_rules * (x.shape[1] + n_terms)):
        u = offsets(x[rows], neurons.centers, neurons.widths)
        columns = design(u, fuzzy_basis(log_firing(u)), n_terms)
        gram += columns.T @ columns
        moment += columns.T @ y[rows]
    return gram, moment


def solve_consequents(neurons: Neurons, x: Array, y: Array, noise: float = 0.0) -> Neurons:
    """Replace the consequents by those of least squared error on standardised data.

    The output is linear in the consequents, so this is where gradient descent on them ends.
    A ridge (see `ridge_for`) settles what the data leaves open.

    Parameters
    ----------
    neurons : Neurons
        The rules; of their consequents only the shape counts.
    x, y : (n, d) and (n, m) arrays
        Standardised data.
    noise : float, default 0
        Standard deviation of the noise of `y`.
    """
    gram, moment = normal_equations(neurons, x, y)
    coefficients = _solve(gram, moment, ridge_for(len(x), noise))
    return Neurons(
        neurons.centers, neurons.widths, coefficients.reshape(neurons.coefficients.shape)
    )


def reduced_error(
    neurons: Neurons, x: Array, y: Array, ridge: float
) -> tuple[float, Neurons, Gradient]:
    """Give half the (ridged) squared error with the best consequents, and its gradient.

    At the best consequents the derivative by them is zero, so the derivative of the reduced
    error by centres and widths is the plain one (variable projection, Golub and Pereyra 1973).

    Parameters
    ----------
    neurons : Neurons
        The rules; of their consequents only the shape counts.
    x, y : (n, d) and (n, m) arrays
        Standardised data.
    ridge : float
        Weight of the squared consequents.

    Returns
    -------
    error : float
        Half the squared error, and half the ridge.
    neurons : Neurons
        The rules with the best consequents.
    gradient : Gradient
        By centres and logarithms of widths.
    """
    u = offsets(x, neurons.centers, neurons.widths)
    basis = fuzzy_basis(log_firing(u))
    columns = design(u, basis, len(neurons.coefficients))
    flat = _solve(columns.T @ columns, columns.T @ y, ridge)
    residual = columns @ flat - y
    solved = Neurons(neurons.centers, neurons.widths, flat.reshape(neurons.coefficients.shape))
    error = 0.5 * (float(np.sum(residual**2)) + ridge * float(np.sum(flat**2)))
    return error, solved, gradient(u, basis, residual, solved)


def adjust(neurons: Neurons, x: Array, y: Array, noise: float, max_iter: int) -> Neurons:
    """Adjust centres, widths and consequents by the gradient of the squared error.

    Quasi-Newton steps (L-BFGS) on centres and logarithms of widths, consequents solved at
    every step. Centres stay inside the box of the data. With noise, the steps have a price
    (the maximum a posteriori one), so that rules do not run after it.

    Parameters
    ----------
    neurons : Neurons
        The rules.
    x, y : (n, d) and (n, m) arrays
        Standardised data.
    noise : float
        Standard deviation of the noise of `y`.
    max_iter : int
        Largest number of steps.

    Returns
    -------
    Neurons
        The adjusted rules.
    """
    n_rules, d = neurons.centers.shape
    size = n_rules * d
    ridge = ridge_for(len(x), noise)
    price = (noise / _EXPECTED_STEP) ** 2
    log_widths = np.log(neurons.widths).ravel()
    unit = np.hstack([neurons.widths.ravel(), np.ones(size)])
    stretch = np.log(_WIDTH_RANGE)
    lower = np.hstack([np.tile(x.min(axis=0), n_rules), log_widths - stretch])
    upper = np.hstack([np.tile(x.max(axis=0), n_rules), log_widths + stretch])
    start = np.clip(np.hstack([neurons.centers.ravel(), log_widths]), lower, upper)

    def unpack(parameters: Array) -> Neurons:
        centers = parameters[:size].reshape(n_rules, d)
        widths = np.exp(parameters[size:]).reshape(n_rules, d)
        return Neurons(centers, widths, neurons.coefficients)

    def error(parameters: Array) -> tuple[float, Array]:
        value, _, slope = reduced_error(unpack(parameters), x, y, ridge)
        step = (parameters - start) / unit
        slopes = np.hstack([slope.centers.ravel(), slope.log_widths.ravel()])
        value += 0.5 * price * float(step @ step)
        return value / len(x), (slopes + price * step / unit) / len(x)

    from scipy.optimize import minimize  # slow to import, and inference does without it

    found = minimize(
        error,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=np.column_stack([lower, upper]),
        options={"maxiter": max_iter, "ftol": 1e-10, "gtol": 1e-12, "maxcor": 20},
    )
    return solve_consequents(unpack(found.x), x, y, noise)


def description_length(neurons: Neurons, x: Array, y: Array, resolution: float) -> float:
    """Weigh error against size: the Bayesian information criterion per row; lower is better.

    Errors below `resolution`, in standardised units, count as none, so that no rule is kept to
    remove them; `x` (n, d) and `y` (n, m) are standardised data.
    """
    error = float(np.mean(np.sum((infer(x, neurons) - y) ** 2, axis=1)))
    size = neurons.coefficients.size + neurons.centers.size + neurons.widths.size
    rows = len(x) * y.shape[1]
    return float(np.log(error + resolution**2) + np.log(max(rows, 2)) * size / rows)


def _solve(gram: Array, moment: Array, ridge: float) -> Array:
    from scipy.linalg import cho_factor, cho_solve

    factor = cho_factor(gram + ridge * np.eye(len(gram)), check_finite=False)
    solution: Array = cho_solve(factor, moment, check_finite=False)
    return solution
