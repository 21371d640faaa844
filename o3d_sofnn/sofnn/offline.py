"""Off-line learning: typical data, then rules from coarse to fine (section 3.1 of the paper)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from o3d_sofnn.sofnn.adjustment import adjust, description_length, solve_consequents
from o3d_sofnn.sofnn.fuzzy_c_means import fuzzy_c_means, partition_memberships
from o3d_sofnn.sofnn.neurons import Array, Neurons
from o3d_sofnn.sofnn.structure import Criteria, combine, grow

# Rows the parameters are adjusted on, and rows per typical datum that fuzzy c-means sees: more
# cost time in proportion and change the rules by less than their tolerance.
_ADJUST_ROWS = 4096


_ROWS_PER_TYPICAL = 20


_NOISE_ROWS = 2000


_MOST_TYPICAL = 200


# The median of the square of a standard normal variable.
_MEDIAN_SQUARE = 0.4549


# The accommodation boundary is halved from level to level; each level is adjusted this long.
_BOUNDARY_FACTOR = 0.5


_LEVEL_ITERATIONS = 50


# A system error must exceed this many standard deviations of the noise left in a typical datum.
_SIGNIFICANCE = 2.0


# Outputs closer than this many noise levels are one typical datum when their inputs agree.
_NOISE_REACH = 3.0


# A root-mean-square error below this share of the tolerance does not justify a rule.
_NEGLIGIBLE = 0.1


@dataclass(frozen=True)
class LearningOptions:
    """Settings of learning; see the parameters of `SOFNN` of the same names."""

    tolerance: float
    boundary: float
    overlap: float
    similarity: float
    n_typical: int | None
    fuzziness: float
    max_rules: int
    n_terms: int
    max_iter: int
    memory: int

    @property
    def resolution(self) -> float:
        """Root-mean-square error that counts as none, in standardised units."""
        return _NEGLIGIBLE * self.tolerance


@dataclass(frozen=True)
class TypicalData:
    """Typical data: inputs (c, d), outputs (c, m), and the rows (c,) each one averages."""

    x: Array
    y: Array
    support: Array


def noise_level(x: Array, y: Array) -> float:
    """Estimate the standard deviation of the noise of `y`, summed over outputs.

    It is the median error of predicting a row from a linear fit to its nearest neighbours,
    corrected for the error of the fit itself.

    Parameters
    ----------
    x, y : (n, d) and (n, m) arrays
        Standardised data.

    Returns
    -------
    float
        Standard deviation; zero if there are too few rows to estimate it.
    """
    n, d = x.shape
    n_neighbors = 2 * (d + 1) + 2
    if n <= n_neighbors:
        return 0.0
    rows = np.linspace(0, n - 1, min(n, _NOISE_ROWS)).astype(int)
    from scipy.spatial import cKDTree  # slow to import, and inference does without it

    _, neighbors = cKDTree(x).query(x[rows], n_neighbors + 1)
    # Among equal inputs the row itself need not come first; it must not predict itself.
    itself = neighbors == rows[:, None]
    itself[~itself.any(axis=1), -1] = True
    neighbors = neighbors[~itself].reshape(len(rows), n_neighbors)
    terms = np.concatenate(
        [np.ones((len(rows), n_neighbors, 1)), x[neighbors] - x[rows, None]], axis=2
    )
    weights = np.linalg.pinv(terms)[:, 0]
    residual = np.einsum("nk,nkm->nm", weights, y[neighbors]) - y[rows]
    variance = np.sum(residual**2, axis=1) / (1.0 + np.sum(weights**2, axis=1))
    return float(np.sqrt(np.median(variance) / _MEDIAN_SQUARE))


def typical_data(
    x: Array, y: Array, noise: float, options: LearningOptions, rng: np.random.Generator
) -> TypicalData:
    """Cluster input-output pairs; the centres resolve conflicts and average out noise.

    The metric of equation (1) weights outputs by their reliability: with noise far above the
    spacing of the centres, rows with equal inputs belong together whatever their outputs.

    Parameters
    ----------
    x, y : (n, d) and (n, m) arrays
        Standardised data.
    noise : float
        Standard deviation of the noise of `y`.
    options : LearningOptions
        Settings.
    rng : Generator
        Chooses rows and first centres.

    Returns
    -------
    TypicalData
        Typical data, or the data themselves if they are too few to be reduced.
    """
    n, d = x.shape
    n_typical = options.n_typical or min(n // 3, _MOST_TYPICAL)
    n_typical = min(n_typical, n - 1)
    if n_typical < 2:
        return TypicalData(x, y, np.ones(n))
    rows = rng.choice(n, min(n, _ROWS_PER_TYPICAL * n_typical), replace=False)
    pairs = np.hstack([x, y])[rows]
    spacing = float(np.ptp(x, axis=0).max()) / n_typical ** (1.0 / d)
    reach = spacing**2 + (_NOISE_REACH * noise) ** 2
    trust = spacing**2 / reach if reach > 0.0 else 1.0
    weights = np.hstack([np.ones(d), np.full(y.shape[1], trust)])
    # Random rows as first centres: random memberships put all of them at the mean, from
    # where a few hundred centres take a thousand iterations to spread.
    root = np.sqrt(weights)
    seeds = pairs[rng.choice(len(pairs), n_typical, replace=False)]
    partition = fuzzy_c_means(
        pairs,
        n_typical,
        m=options.fuzziness,
        metric=np.diag(weights),
        memberships=partition_memberships(pairs * root, seeds * root, options.fuzziness),
        tol=1e-3,
        max_iter=30,
    )
    share = partition.memberships**options.fuzziness
    support = share.sum(axis=0) ** 2 / np.maximum(np.sum(share**2, axis=0), 1e-300)
    return TypicalData(partition.centers[:, :d], partition.centers[:, d:], support)


def learn(
    x: Array, y: Array, options: LearningOptions, rng: np.random.Generator
) -> tuple[Neurons, TypicalData]:
    """Learn rules from standardised data, wide ones first.

    Neurons are generated on typical data with an accommodation boundary that is halved from
    level to level, so that narrow rules appear only where wide ones fail; after every level
    the parameters are adjusted and similar neurons combined. The level with the smallest
    description length is chosen, so that noise does not create rules.

    Parameters
    ----------
    x, y : (n, d) and (n, m) arrays
        Standardised data, n >= 1.
    options : LearningOptions
        Settings.
    rng : Generator
        Chooses rows.

    Returns
    -------
    neurons : Neurons
        Standardised rules.
    typical : TypicalData
        Typical data that they were generated on.
    """
    n, d = x.shape
    noise = noise_level(x, y)
    typical = typical_data(x, y, noise, options, rng)
    tolerance = np.maximum(
        options.tolerance, _SIGNIFICANCE * noise / np.sqrt(np.maximum(typical.support, 1.0))
    )
    rows = np.sort(rng.choice(n, min(n, _ADJUST_ROWS), replace=False))
    samples = (x[rows], y[rows])
    per_rule = options.n_terms * y.shape[1] + 2 * d
    # At least two rows for every parameter; fewer cannot tell rules from noise.
    most = max(1, min(options.max_rules, y.shape[1] * len(rows) // (2 * per_rule)))
    neurons = solve_consequents(_first_neuron(d, y.shape[1], options.n_terms), *samples, noise)
    best, length = neurons, description_length(neurons, *samples, options.resolution)
    boundary = 0.5 * float(np.linalg.norm(np.ptp(typical.x, axis=0)))
    while len(neurons) < most:
        last = boundary <= options.boundary
        boundary = max(boundary, options.boundary)
        criteria = Criteria(tolerance, boundary, options.overlap, most)
        grown = grow(neurons, (typical.x, typical.y), criteria, samples, noise)
        shorter = False
        if len(grown) > len(neurons):
            neurons = refine(grown, samples, noise, options, _LEVEL_ITERATIONS)
            refined = description_length(neurons, *samples, options.resolution)
            shorter = refined < length
            if shorter:
                best, length = neurons, refined
            else:
                neurons = best
        # The finest level is repeated as long as it pays.
        if last and not shorter:
            break
        boundary *= _BOUNDARY_FACTOR
    best = refine(best, samples, noise, options, options.max_iter)
    return solve_consequents(best, x, y, noise), typical


def refine(
    neurons: Neurons,
    samples: tuple[Array, Array],
    noise: float,
    options: LearningOptions,
    max_iter: int,
) -> Neurons:
    """Adjust the parameters, then combine what has become similar.

    Parameters
    ----------
    neurons : Neurons
        Standardised rules.
    samples : pair of (n, d) and (n, m) arrays
        Standardised data.
    noise : float
        Standard deviation of the noise of the outputs.
    options : LearningOptions
        Settings.
    max_iter : int
        Largest number of gradient steps.
    """
    neurons = adjust(neurons, *samples, noise, max_iter)
    neurons, _ = combine(
        neurons, np.ones(len(neurons)), options.similarity, samples, noise, options.resolution
    )
    return neurons


def _first_neuron(d: int, n_outputs: int, n_terms: int) -> Neurons:
    """Start from one rule at the mean that covers all of the (standardised) data."""
    return Neurons(np.zeros((1, d)), np.full((1, d), 2.0), np.zeros((n_terms, 1, n_outputs)))
