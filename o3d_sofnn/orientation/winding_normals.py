"""Stage 5: area-weighted normals whose winding number is one half at the samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import WindingLists, WindingTree
from o3d_sofnn.geometry.vectors import unit

Array = NDArray[np.float64]


OPENING = 0.6
"""Opening angle of the tree code: a node is replaced by its moments if it appears smaller. With
first-order moments, 0.6 is as accurate as 0.3 with order zero, at half the cost."""


ROUNDS, STEPS, SOLVED = 2, 10, 0.01
"""Rounds of conjugate gradients, steps in each, and fraction of the first gradient at which a round
ends early: nested shells and walls around many cavities need that many. Many more would fit the
noise; between the rounds, the directions forget the noise they have fitted."""


SETTLED, MOST = 5e-4, 40
"""Share of samples changing sides below which the iteration at the coarse width ends, and largest
number of iterations."""


NARROWING = 5
"""Number of iterations from the coarse to the fine width."""


def winding_number_normals(
    x: Array, areas: Array, weights: Array, coarse: Array, fine: Array
) -> Array:
    """Find normals whose winding number is one half on the surface and whose gradient they are.

    This combines two published methods. Lin et al., "Surface reconstruction from point clouds
    without normals by parametrizing the Gauss formula" (2022), solve ``A mu = 1/2`` by conjugate
    gradients, which finds the sides of nested surfaces. Lin, Shi and Liu, "Fast and globally
    consistent normal orientation based on the winding number normal consistency" (2024), alternate
    gradient steps with ``mu <- |mu| * unit(-grad(winding number of mu))``, which removes the noise
    from the directions but alone may end with inner surfaces flipped and shrunk. When the sides
    have settled, known areas replace the lengths, which have fitted the noise by then.

    Parameters
    ----------
    x : (m, 3) float64
        Positions on the surface or scattered around it.
    areas : (m,) float64
        Area of the surface around each position, in any unit.
    weights : (m,) float64
        How much each position counts: where dense and sparse parts meet, equal weights would let
        the dense ones decide.
    coarse, fine : (m,) float64
        Smoothing width at each position until the sides have settled, and at the end, in the unit
        of the points.

    Returns
    -------
    (m, 3) float64
        Area-weighted outward normals.
    """
    order = np.asarray(WindingTree(x, np.ones(len(x))).order())
    sorted_x, coarse, fine = np.ascontiguousarray(x[order]), coarse[order], fine[order]
    tree = WindingTree(sorted_x, np.ones(len(x)))
    roots = np.sqrt(weights[order])
    samples = _Samples(tree, tree.lists(sorted_x, OPENING), roots)
    solved = SOLVED**2 * float((samples.descent(0.5 * roots, coarse) ** 2).sum())
    mu = np.zeros_like(sorted_x)
    for iteration in range(MOST):
        steps = STEPS if iteration < ROUNDS else 1
        before, mu = mu, samples.descend(mu, coarse, steps, solved)
        changed = (np.einsum("nd,nd->n", before, mu) < 0.0).mean()
        if iteration >= ROUNDS and changed < SETTLED:
            break
    mu = unit(mu) * areas[order, None]
    winding = samples.winding(mu, coarse)
    square = float((winding**2).sum())
    if square > 0.0:  # zero everywhere for points on a line
        mu *= 0.5 * winding.sum() / square
    for width in np.geomspace(coarse, fine, NARROWING):
        mu = samples.descend(mu, width, 1, 0.0)
    result = np.empty_like(mu)
    result[order] = mu
    return result


@dataclass(frozen=True)
class _Samples:
    """Samples in the order of their tree, and the sums at each of them."""

    tree: WindingTree
    lists: WindingLists
    roots: Array  # square roots of the weights

    def winding(self, mu: Array, width: Array) -> Array:
        """Return the winding number at the samples: ``A mu``."""
        return np.asarray(self.tree.winding_at(mu, self.lists, width))

    def descent(self, error: Array, width: Array) -> Array:
        """Return the negative gradient of half the squared weighted error, ``A.T`` times it."""
        adjoint = self.tree.adjoint_at(self.roots * error, self.lists, width)
        return -self.roots[:, None] * np.asarray(adjoint)

    def descend(self, mu: Array, width: Array, steps: int, solved: float) -> Array:
        """Move the winding number towards one half, then take the directions of its gradient.

        Unknowns and errors are multiplied by the roots of the weights, so that neither a position
        that counts little has much influence, nor the equations for it.
        """
        winding = self.winding(mu, width) if mu.any() else np.zeros(len(mu))
        error = self.roots * (0.5 - winding)
        descent = direction = self.descent(error, width)
        square = float((descent**2).sum())
        for step in range(steps):
            change = self.roots[:, None] * direction
            response = self.roots * self.winding(change, width)
            scale = float((response**2).sum())
            if scale == 0.0:
                break
            mu = mu + square / scale * change
            if step + 1 == steps:
                break
            error = error - square / scale * response
            descent = self.descent(error, width)
            before, square = square, float((descent**2).sum())
            if square < solved:
                break
            direction = descent + square / before * direction
        gradient = np.asarray(self.tree.gradient_at(mu, self.lists, width)[1])
        return np.asarray(np.linalg.norm(mu, axis=1, keepdims=True) * unit(gradient))
