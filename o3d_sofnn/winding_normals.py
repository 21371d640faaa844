"""Stage 5: area-weighted normals whose winding number is one half on the samples themselves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ._kernels import WindingLists, WindingTree
from .vectors import unit

Array = NDArray[np.float64]

OPENING = 0.6
"""Opening angle of the tree code: a node is summed by its moments when it looks smaller. To first
order, 0.6 errs as little as 0.3 does to order zero, at half the cost."""
ROUNDS, STEPS, SOLVED = 2, 10, 0.01
"""Rounds of conjugate gradients, steps in each, and share of the first gradient that ends them
sooner: shells in shells and walls around many cavities need that many. Many more learn the noise,
and between the rounds directions lose what they have learnt."""
SETTLED, MOST = 5e-4, 40
"""Share of the samples that still change sides when the iteration at the coarse width ends, and the
most iterations."""
NARROWING = 5
"""Iterations on the way to the fine width."""


def winding_number_normals(
    x: Array, areas: Array, coarse: Array, fine: Array, n_threads: int
) -> Array:
    """Find normals whose winding number is one half on the surface and that are its gradient.

    Two published methods in turn. Lin et al., "Surface reconstruction from point clouds without
    normals by parametrizing the Gauss formula" (2022), solve ``A mu = 1/2`` by conjugate gradients:
    that finds which side of nested surfaces is which. Lin, Shi and Liu, "Fast and globally
    consistent normal orientation based on the winding number normal consistency" (2024), then let
    gradient steps alternate with ``mu <- |mu| * unit(-grad(winding number of mu))``, which takes
    the noise out of the directions but alone may stop with inner surfaces turned and faded. When
    the sides have settled known areas replace lengths, which have learned the noise by then.

    Parameters
    ----------
    x : (m, 3) float64
        Positions on the surface or scattered about it.
    areas : (m,) float64
        Area of the surface around each position, over any unit.
    coarse, fine : (m,) float64
        Smoothing width at each position until the sides have settled, and at last, in the unit of
        the points.
    n_threads : int
        Threads.

    Returns
    -------
    (m, 3) float64
        Area-weighted outward normals.
    """
    order = np.asarray(WindingTree(x, np.ones(len(x))).order())
    sorted_x, coarse, fine = np.ascontiguousarray(x[order]), coarse[order], fine[order]
    tree = WindingTree(sorted_x, np.ones(len(x)))
    samples = _Samples(tree, tree.lists(sorted_x, OPENING, n_threads), n_threads)
    half = np.full(len(x), 0.5)
    solved = SOLVED**2 * float((samples.descent(half, coarse) ** 2).sum())
    mu = np.zeros_like(sorted_x)
    for iteration in range(MOST):
        steps = STEPS if iteration < ROUNDS else 1
        before, mu = mu, samples.descend(mu, coarse, steps, solved)
        changed = (np.einsum("nd,nd->n", before, mu) < 0.0).mean()
        if iteration >= ROUNDS and changed < SETTLED:
            break
    mu = unit(mu) * areas[order, None]
    winding = samples.winding(mu, coarse)
    mu *= 0.5 * winding.sum() / (winding**2).sum()
    for width in np.geomspace(coarse, fine, NARROWING):
        mu = samples.descend(mu, width, 1, 0.0)
    result = np.empty_like(mu)
    result[order] = mu
    return result


@dataclass(frozen=True)
class _Samples:
    """Samples in the order of their tree, and what is summed at each of them."""

    tree: WindingTree
    lists: WindingLists
    n_threads: int

    def winding(self, mu: Array, width: Array) -> Array:
        """Winding number at the samples: ``A mu``."""
        return np.asarray(self.tree.winding_at(mu, self.lists, width, self.n_threads))

    def descent(self, error: Array, width: Array) -> Array:
        """Downhill gradient of half the squared error: the transposed ``A`` times the error."""
        return -np.asarray(self.tree.adjoint_at(error, self.lists, width, self.n_threads))

    def descend(self, mu: Array, width: Array, steps: int, solved: float) -> Array:
        """Bring the winding number closer to one half, then take the directions of its gradient."""
        error = 0.5 - (self.winding(mu, width) if mu.any() else np.zeros(len(mu)))
        descent = direction = self.descent(error, width)
        square = float((descent**2).sum())
        for step in range(steps):
            response = self.winding(direction, width)
            scale = float((response**2).sum())
            if scale == 0.0:
                break
            mu = mu + square / scale * direction
            if step + 1 == steps:
                break
            error = error - square / scale * response
            descent = self.descent(error, width)
            before, square = square, float((descent**2).sum())
            if square < solved:
                break
            direction = descent + square / before * direction
        gradient = np.asarray(self.tree.gradient_at(mu, self.lists, width, self.n_threads)[1])
        return np.asarray(np.linalg.norm(mu, axis=1, keepdims=True) * unit(gradient))
