"""Adjustment of the parameters of the rules by the gradient of the squared error (section 3.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from o3d_sofnn.sofnn.fuzzy_c_means import row_chunks
from o3d_sofnn.sofnn.neurons import (
    Array,
    Neurons,
    design,
    fuzzy_basis,
    infer,
    log_firing,
    offsets,
    sensitivity,
)

# One adjustment may change a width by this factor at most; larger steps leave narrow gaps in
# which a network that fits every sample is free to do anything.
_WIDTH_RANGE = 4.0


# Expected standard deviation of an adjustment, in widths (centres) and log units (widths).
_EXPECTED_STEP = 0.3


# Damping of the first step, its change from step to step, and its range, as a share of the
# largest curvature.
_FIRST_DAMPING = 1.0
_DAMPING_FACTOR = 4.0
_LEAST_DAMPING = 1e-9
_LARGEST_DAMPING = 1e3


# A step that lowers the error by less than this share of it is the last one.
_LEAST_GAIN = 1e-4


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
    coefficients = _solver(gram, ridge_for(len(x), noise))(moment)
    return Neurons(
        neurons.centers, neurons.widths, coefficients.reshape(neurons.coefficients.shape)
    )


@dataclass(frozen=True)
class Reduced:
    """Rules with the consequents of least squared error, and the remaining error.

    At the best consequents, the derivative with respect to them is zero, so the error is a function
    of centres and widths alone (variable projection, Golub and Pereyra 1973).

    Attributes
    ----------
    neurons : Neurons
        The rules with the best consequents.
    error : float
        Half the squared error. The ridge settles the consequents and no more: centres that
        would pay for it lose accuracy.
    residual : (n, m) array
        Output minus desired output.
    """

    neurons: Neurons
    error: float
    residual: Array
    _offsets: Array
    _basis: Array
    _columns: Array
    _solve: Callable[[Array], Array]

    @classmethod
    def of(cls, neurons: Neurons, x: Array, y: Array, ridge: float) -> Reduced:
        """Solve for the consequents of `neurons`, of which only the shape counts.

        `x` (n, d) and `y` (n, m) are standardised data, `ridge` the weight of the squared
        consequents.
        """
        u = offsets(x, neurons.centers, neurons.widths)
        basis = fuzzy_basis(log_firing(u))
        columns = design(u, basis, len(neurons.coefficients))
        solve = _solver(columns.T @ columns, ridge)
        flat = solve(columns.T @ y)
        residual = columns @ flat - y
        error = 0.5 * float(np.sum(residual**2))
        coefficients = flat.reshape(neurons.coefficients.shape)
        solved = Neurons(neurons.centers, neurons.widths, coefficients)
        return cls(solved, error, residual, u, basis, columns, solve)

    def derivatives(self) -> tuple[Array, Array]:
        """Differentiate with respect to centres (in widths) and logarithms of widths.

        Returns
        -------
        jacobian : (m * n, 2 * M * d) array
            Derivatives of the residual, with the consequents solved for, one output after the other
            (Kaufman's approximation, 1975).
        gradient : (2 * M * d,) array
            Gradient of the error, exact except for the ridge.
        """
        blocks = []
        gradient = np.zeros(2 * self.neurons.centers.size)
        outputs = np.moveaxis(self.neurons.coefficients, 2, 0)
        for coefficients, residual in zip(outputs, self.residual.T, strict=True):
            plain = sensitivity(self._offsets, self._basis, coefficients)
            plain -= self._columns @ self._solve(self._columns.T @ plain)
            gradient += plain.T @ residual
            blocks.append(plain)
        return np.concatenate(blocks), gradient


def adjust(neurons: Neurons, x: Array, y: Array, noise: float, max_iter: int) -> Neurons:
    """Adjust centres, widths and consequents by the gradient of the squared error.

    Damped Gauss-Newton steps (Levenberg 1944) on centres and logarithms of widths, each of one
    width at most; the consequents are solved for at every step. A step that does not lower the
    error is undone. Centres stay inside the box of the data. With noise, the steps are penalised
    (maximum a posteriori estimate), so that rules do not fit it.

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
    # Centres in widths of their rules at the start, widths by their logarithm: free of units.
    unit = np.hstack([neurons.widths.ravel(), np.ones(size)])
    log_widths = np.log(neurons.widths).ravel()
    stretch = np.log(_WIDTH_RANGE)
    lower = np.hstack([np.tile(x.min(axis=0), n_rules), log_widths - stretch]) / unit
    upper = np.hstack([np.tile(x.max(axis=0), n_rules), log_widths + stretch]) / unit
    start = np.clip(np.hstack([neurons.centers.ravel(), log_widths]) / unit, lower, upper)

    def reduced(at: Array) -> tuple[Reduced, float]:
        centers = (at * unit)[:size].reshape(n_rules, d)
        widths = np.exp(at[size:]).reshape(n_rules, d)
        found = Reduced.of(Neurons(centers, widths, neurons.coefficients), x, y, ridge)
        return found, found.error + 0.5 * price * float(np.sum((at - start) ** 2))

    at, damping = start, _FIRST_DAMPING
    now, error = reduced(at)
    for _ in range(max_iter):
        jacobian, slope = now.derivatives()
        by_start = unit[:size] / now.neurons.widths.ravel()
        jacobian[:, :size] *= by_start
        slope[:size] *= by_start
        slope += price * (at - start)
        free = ~(((at <= lower) & (slope > 0.0)) | ((at >= upper) & (slope < 0.0)))
        before = error
        while damping < _LARGEST_DAMPING:
            step = np.zeros_like(at)
            step[free] = _damped_step(jacobian[:, free], slope[free], price, damping)
            step /= max(1.0, float(np.abs(step).max(initial=0.0)))
            trial = np.clip(at + step, lower, upper)
            found, found_error = reduced(trial)
            if found_error < error:
                at, now, error = trial, found, found_error
                damping = max(damping / _DAMPING_FACTOR, _LEAST_DAMPING)
                break
            damping *= _DAMPING_FACTOR
        if before - error <= _LEAST_GAIN * before:
            break
    return now.neurons


def _damped_step(jacobian: Array, slope: Array, price: float, damping: float) -> Array:
    """Minimise the linearised error plus price and damping, the latter per largest curvature."""
    rows, columns = jacobian.shape
    curvature = np.einsum("np,np->p", jacobian, jacobian)
    weight = price + damping * float(curvature.max(initial=0.0)) + np.finfo(float).tiny
    if columns <= rows:
        return -_solver(jacobian.T @ jacobian, weight)(slope)
    # Fewer rows than parameters: the same step from the smaller system (Woodbury's identity).
    inner = _solver(jacobian @ jacobian.T, weight)(jacobian @ slope)
    step: Array = (jacobian.T @ inner - slope) / weight
    return step


def description_length(neurons: Neurons, x: Array, y: Array, resolution: float) -> float:
    """Weigh error against size: the Bayesian information criterion per row; lower is better.

    Errors below `resolution`, in standardised units, count as none, so that no rule is kept to
    remove them; `x` (n, d) and `y` (n, m) are standardised data.
    """
    error = float(np.mean(np.sum((infer(x, neurons) - y) ** 2, axis=1)))
    size = neurons.coefficients.size + neurons.centers.size + neurons.widths.size
    rows = len(x) * y.shape[1]
    return float(np.log(error + resolution**2) + np.log(max(rows, 2)) * size / rows)


def _solver(gram: Array, ridge: float) -> Callable[[Array], Array]:
    """Factorise `gram` (k, k), positive semi-definite, plus a ridge; give what solves with it."""
    from scipy.linalg import cho_factor, cho_solve  # slow to import, inference does without it

    gram = gram.copy()
    gram[np.diag_indices(len(gram))] += ridge
    factor = cho_factor(gram, check_finite=False)
    return lambda moment: np.asarray(cho_solve(factor, moment, check_finite=False), np.float64)
