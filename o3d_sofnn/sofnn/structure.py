"""Structure learning: generation and combination of neurons, section 3.2 of the paper."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from o3d_sofnn.sofnn.adjustment import description_length, solve_consequents
from o3d_sofnn.sofnn.fuzzy_c_means import row_chunks
from o3d_sofnn.sofnn.neurons import Array, Neurons, infer, offsets


def nearest_distance(x: Array, centers: Array) -> Array:
    """Give the (n,) Euclidean distance to the nearest centre, `d_min` of equation (10)."""
    distance = np.zeros(len(x))
    for rows in row_chunks(len(x), centers.size):
        u = offsets(x[rows], centers, np.ones_like(centers))
        distance[rows] = np.sqrt(np.einsum("inj,inj->nj", u, u).min(axis=1))
    return distance


def generate(neurons: Neurons, x: Array, y: Array, d_min: float, overlap: float) -> Neurons:
    """Append a neuron at observation (x, y), whose nearest centre is `d_min` away."""
    n_terms, _, n_outputs = neurons.coefficients.shape
    consequent = np.zeros((n_terms, 1, n_outputs))
    consequent[0, 0] = y
    width = np.full((1, len(x)), overlap * d_min)  # Eq. (10)
    return Neurons(
        np.vstack([neurons.centers, x]),
        np.vstack([neurons.widths, width]),
        np.concatenate([neurons.coefficients, consequent], axis=1),
    )


class Criteria(NamedTuple):
    """When a neuron is generated, eq. (10).

    Attributes
    ----------
    tolerance : (c,) array
        Largest system error accepted at each typical datum.
    boundary : float
        Accommodation boundary: no neuron is generated closer than this to another one.
    overlap : float
        Width of a new neuron divided by its distance to the nearest one, `k` of equation (10).
    max_rules : int
        Largest number of neurons.
    """

    tolerance: Array
    boundary: float
    overlap: float
    max_rules: int


def grow(
    neurons: Neurons,
    typical: tuple[Array, Array],
    criteria: Criteria,
    samples: tuple[Array, Array],
    noise: float,
) -> Neurons:
    """Generate a neuron at the worst typical datum until every one is within its tolerance.

    Parameters
    ----------
    neurons : Neurons
        The rules so far, at least one.
    typical : pair of (c, d) and (c, m) arrays
        Typical data, inputs and outputs.
    criteria : Criteria
        When a neuron is generated.
    samples : pair of (n, d) and (n, m) arrays
        Standardised data the consequents are fitted to after each generation.
    noise : float
        Standard deviation of the noise of the sample outputs.

    Returns
    -------
    Neurons
        The given neurons followed by the generated ones.
    """
    x, y = typical
    while len(neurons) < criteria.max_rules:
        error = np.linalg.norm(infer(x, neurons) - y, axis=1)
        d_min = nearest_distance(x, neurons.centers)
        excess = np.where(d_min > criteria.boundary, error - criteria.tolerance, -1.0)
        worst = int(excess.argmax())
        if excess[worst] <= 0.0:
            break
        neurons = generate(neurons, x[worst], y[worst], float(d_min[worst]), criteria.overlap)
        neurons = solve_consequents(neurons, *samples, noise)
    return neurons


def similarity(neurons: Neurons) -> Array:
    """Give the (M, M) similarity of the membership functions of all pairs of neurons.

    The cosine between Gaussians as functions, multiplied over the dimensions: one for equal
    membership functions, towards zero for distant ones or very different widths.
    """
    total = neurons.widths[:, None] ** 2 + neurons.widths**2
    overlap = 2.0 * neurons.widths[:, None] * neurons.widths / total
    gap = (neurons.centers[:, None] - neurons.centers) ** 2 / total
    table: Array = np.exp(0.5 * np.sum(np.log(overlap) - gap, axis=2))
    return table


def merge(neurons: Neurons, weights: Array, kept: int, dropped: int) -> tuple[Neurons, Array]:
    """Replace neuron `kept` by the weighted mean of itself and `dropped`; remove the latter.

    `weights` (M,) is the evidence behind each rule; the combined one has that of both.
    """
    total = weights[kept] + weights[dropped]
    share = weights[dropped] / total if total > 0.0 else 0.5
    centers, widths = neurons.centers.copy(), neurons.widths.copy()
    coefficients = neurons.coefficients.copy()
    centers[kept] += share * (centers[dropped] - centers[kept])
    # Geometric mean: a width is a scale.
    widths[kept] *= (widths[dropped] / widths[kept]) ** share
    coefficients[:, kept] += share * (coefficients[:, dropped] - coefficients[:, kept])
    weights = weights.copy()
    weights[kept] = total
    left = np.arange(len(neurons)) != dropped
    return Neurons(centers[left], widths[left], coefficients[:, left]), weights[left]


def combine(
    neurons: Neurons,
    weights: Array,
    threshold: float,
    samples: tuple[Array, Array],
    noise: float,
    resolution: float,
) -> tuple[Neurons, Array]:
    """Combine neurons with similar membership functions, the most similar pair first.

    A combination is kept if the shorter rule base describes the samples at least as well
    (see `description_length`); two similar neurons with opposite consequents form
    a steep edge and stay.

    Parameters
    ----------
    neurons : Neurons
        The rules.
    weights : (M,) array
        Evidence behind each rule.
    threshold : float
        Similarity from which two neurons may be combined.
    samples : pair of (n, d) and (n, m) arrays
        Standardised data the consequents are fitted to.
    noise : float
        Standard deviation of the noise of the sample outputs.
    resolution : float
        Error that counts as none.

    Returns
    -------
    neurons : Neurons
        The rules left.
    weights : (M',) array
        Their evidence.
    """
    length = description_length(neurons, *samples, resolution)
    table = _pairs(neurons)
    while table.max() >= threshold:
        kept, dropped = (int(i) for i in np.unravel_index(int(table.argmax()), table.shape))
        fewer, fewer_weights = merge(neurons, weights, kept, dropped)
        fewer = solve_consequents(fewer, *samples, noise)
        fewer_length = description_length(fewer, *samples, resolution)
        if fewer_length <= length:
            refused = np.delete(np.delete(table < 0.0, dropped, 0), dropped, 1)
            refused[kept] = refused[:, kept] = False
            neurons, weights, length = fewer, fewer_weights, fewer_length
            table = np.where(refused, -1.0, _pairs(neurons))
        else:
            table[kept, dropped] = -1.0
    return neurons, weights


def _pairs(neurons: Neurons) -> Array:
    """Give the similarity of every pair once, above the diagonal; -1 elsewhere."""
    above = np.triu(np.ones((len(neurons), len(neurons)), dtype=bool), 1)
    return np.where(above, similarity(neurons), -1.0)
