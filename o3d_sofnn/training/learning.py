"""Off-line learning: clouds of generated shapes, networks, and the choice of the best."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from o3d_sofnn.rules.trust import EMPHASIS, INPUTS
from o3d_sofnn.sofnn.estimator import SOFNN
from o3d_sofnn.training.lessons import Lessons, draw_pairs, lessons
from o3d_sofnn.training.shapes import SHAPES, draw

NOISES = (0.0, 0.0, 0.00125, 0.0025, 0.005, 0.01)
"""Noise of the clouds, divided by the diagonal."""
POINTS = (6000, 25000)
"""Smallest and largest number of points in a cloud."""
PLACES, PAIRS = 2500, 1500
"""Number of queries in a cloud, and of pairs of a query and a rule drawn from it."""
MOST_RULES = 8
"""Largest number of rules in the network: few can be read and are cheap to evaluate."""


def clouds(rounds: int, seed: int = 7) -> Iterator[Lessons]:
    """Yield examples from clouds of all shapes at all noise levels, some of uneven density.

    Parameters
    ----------
    rounds : int
        Number of clouds of each shape.
    seed : int, default 7
        Seed of everything that is drawn.
    """
    rng = np.random.default_rng(seed)
    for turn in range(rounds):
        for number, shape in enumerate(SHAPES):
            count = int(np.exp(rng.uniform(*np.log(POINTS))))
            noise = NOISES[(3 * turn + number) % len(NOISES)]
            uneven = float(rng.choice([0.0, 0.0, 2.0]))
            points, normals = draw(shape(rng), count, noise, uneven, rng)
            yield lessons(points, normals, PLACES)


def learn(found: Sequence[Lessons], trials: int) -> tuple[SOFNN, float]:
    """Fit networks from several seeds and keep the one whose inferred normals are best.

    Parameters
    ----------
    found : sequence of Lessons
        Training samples, to which networks are fitted and by which they are judged.
    trials : int
        Number of networks.

    Returns
    -------
    network : SOFNN
        The best one.
    gain : float
        Error of the inferred normals with it, divided by the error without it (geometric mean of
        the clouds).
    """
    best: tuple[float, SOFNN] | None = None
    for seed in range(trials):
        inputs, outputs = draw_pairs(found, PAIRS, np.random.default_rng(seed))
        network = SOFNN(
            consequent="linear",
            max_rules=MOST_RULES,
            n_typical=60,
            adjust_steps=80,
            tolerance=0.2,
            boundary=0.3,
            random_state=seed,
        ).fit(inputs, outputs)
        error = gain(network, found)
        if best is None or error < best[0]:
            best = error, network
    if best is None:
        raise ValueError(f"trials: expected at least 1, got {trials}")
    return best[1], best[0]


def gain(network: SOFNN, found: Sequence[Lessons]) -> float:
    """Return the error of the normals with the network, divided by the error without it."""
    ratios = []
    for cloud in found:
        expected = network.predict(cloud.inputs.reshape(-1, len(INPUTS)))
        trust = -EMPHASIS * expected.reshape(cloud.memberships.shape)
        ratios.append(np.log(cloud.error(trust) / cloud.error(0.0)))
    return float(np.exp(np.mean(ratios)))
