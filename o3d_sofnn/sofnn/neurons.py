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

    Subtracting the largest logarithm first avoids 0/0: far from all rules, the relatively nearest
    one determines the output.
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


def sensitivity(u: Array, basis: Array, coefficients: Array) -> Array:
    """Differentiate one output of the network with respect to the premises of its rules.

    Parameters
    ----------
    u : (d, n, M) array
        Offsets of the data.
    basis : (n, M) array
        Fuzzy basis functions of the data.
    coefficients : (p, M) array
        Consequents of the output.

    Returns
    -------
    (n, 2 * M * d) array
        Derivatives with respect to the centres, in units of the widths, then to the logarithms of
        the widths: rule by rule, dimension by dimension. Neither depends on the unit of the data.
    """
    d, n, n_rules = u.shape
    alone = np.broadcast_to(coefficients[0], (n, n_rules)).copy()
    for i, slopes in enumerate(coefficients[1:]):
        alone += slopes * u[i]
    output = np.einsum("nj,nj->n", basis, alone)
    # d(output)/d(log firing_j) = basis_j (output of rule j - output of the network).
    by_firing = basis * (alone - output[:, None])
    by = np.zeros((n, 2, n_rules, d))
    for i in range(d):
        along = by_firing * u[i]
        if len(coefficients) > 1:
            along -= basis * coefficients[1 + i]
        by[:, 0, :, i] = along
        by[:, 1, :, i] = along * u[i]
    return by.reshape(n, 2 * n_rules * d)
