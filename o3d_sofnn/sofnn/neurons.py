"""Elliptical basis neurons and their inference: equations (7), (8), (9) and (11) of the paper."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.sofnn.fuzzy_c_means import row_chunks

Array = NDArray[np.float64]


# Beyond this many widths a point is "infinitely" far; the square must stay below overflow.
_FARTHEST = 1e150


@dataclass(frozen=True)
class Neurons:
    """A fuzzy rule base: one Gaussian neuron of elliptical shape per rule.

    Attributes
    ----------
    centers : (M, d) float64
        Centres of the membership functions.
    widths : (M, d) float64
        Standard deviations of the membership functions, positive.
    coefficients : (p, M, m) float64
        Consequents. Row 0 is the value at the centre, the matrix of equation (8) transposed;
        with p = 1 + d, row 1 + i is the slope along (x_i - c_i) / width_i.
    """

    centers: Array
    widths: Array
    coefficients: Array

    def __len__(self) -> int:
        """Give the number of rules."""
        return len(self.centers)


@dataclass(frozen=True)
class Gradient:
    """Derivatives of half the squared error; same shapes as the parameters of `Neurons`."""

    centers: Array
    log_widths: Array
    coefficients: Array


def offsets(x: Array, centers: Array, widths: Array) -> Array:
    """Give (x - centre) / width as a (d, n, M) array, clipped where squares would overflow."""
    u = np.zeros((x.shape[1], len(x), len(centers)))
    with np.errstate(over="ignore"):  # an infinite offset is clipped like any far one
        for i, plane in enumerate(u):
            np.subtract(x[:, i, None], centers[:, i], out=plane)
            plane /= widths[:, i]
    return np.clip(u, -_FARTHEST, _FARTHEST, out=u)


def log_firing(u: Array) -> Array:
    """Give the (n, M) logarithm of the product of the membership functions at offsets `u`."""
    exponent: Array = -0.5 * np.einsum("inj,inj->nj", u, u)  # Eq. (11)
    return exponent


def fuzzy_basis(log_strength: Array) -> Array:
    """Normalise firing strengths over the rules.

    Subtracting the largest logarithm first keeps 0/0 out: far from all rules the relatively
    nearest one answers.
    """
    basis: Array = np.exp(log_strength - log_strength.max(axis=1, keepdims=True))
    basis /= basis.sum(axis=1, keepdims=True)  # Eq. (9)
    return basis


def design(u: Array, basis: Array, n_terms: int) -> Array:
    """Give the (n, p * M) matrix that maps the flattened coefficients to the output."""
    n, n_rules = basis.shape
    columns = np.zeros((n, n_terms, n_rules))
    columns[:, 0] = basis
    for i in range(n_terms - 1):
        np.multiply(basis, u[i], out=columns[:, 1 + i])
    return columns.reshape(n, n_terms * n_rules)


def infer(x: Array, neurons: Neurons) -> Array:
    """Give the (n, m) output of the network at the rows of `x`, in bounded memory."""
    n_terms, n_rules, n_outputs = neurons.coefficients.shape
    flat = neurons.coefficients.reshape(n_terms * n_rules, n_outputs)
    y = np.zeros((len(x), n_outputs))
    for rows in row_chunks(len(x), n_rules * (x.shape[1] + n_terms)):
        u = offsets(x[rows], neurons.centers, neurons.widths)
        y[rows] = design(u, fuzzy_basis(log_firing(u)), n_terms) @ flat  # Eq. (7)
    return y


def firing_strength(x: Array, neurons: Neurons) -> Array:
    """Give the (n,) largest firing strength, in [0, 1]: how well the rules cover each row."""
    strength = np.zeros(len(x))
    for rows in row_chunks(len(x), len(neurons) * (x.shape[1] + 1)):
        u = offsets(x[rows], neurons.centers, neurons.widths)
        strength[rows] = np.exp(log_firing(u).max(axis=1))
    return strength


def gradient(u: Array, basis: Array, residual: Array, neurons: Neurons) -> Gradient:
    """Differentiate half the squared error of a batch.

    Parameters
    ----------
    u : (d, n, M) array
        Offsets of the batch.
    basis : (n, M) array
        Fuzzy basis functions of the batch.
    residual : (n, m) array
        Output minus desired output.
    neurons : Neurons
        The rules that gave `u`, `basis` and `residual`.

    Returns
    -------
    Gradient
        Summed over the batch. Widths are differentiated by their logarithm, so that a step
        along it keeps them positive and does not depend on the unit.
    """
    n_terms, n_rules, _ = neurons.coefficients.shape
    d = len(u)
    # pull[k, j] = residual_k . (output of rule j alone at k), term by term of its polynomial.
    pull = residual @ neurons.coefficients[0].T
    slopes = [residual @ neurons.coefficients[1 + i].T for i in range(n_terms - 1)]
    for i, slope in enumerate(slopes):
        pull += slope * u[i]
    # d(output)/d(log firing_j) = basis_j (output of rule j - output of the network).
    output_pull = np.einsum("nj,nj->n", basis, pull)
    by_firing = basis * (pull - output_pull[:, None])
    centers = np.zeros((n_rules, d))
    log_widths = np.zeros((n_rules, d))
    for i in range(d):
        along = by_firing * u[i]
        if slopes:
            along -= basis * slopes[i]
        centers[:, i] = along.sum(axis=0) / neurons.widths[:, i]
        log_widths[:, i] = np.einsum("nj,nj->j", along, u[i])
    coefficients = design(u, basis, n_terms).T @ residual
    return Gradient(centers, log_widths, coefficients.reshape(neurons.coefficients.shape))
