"""Stage 8: one function over all space. Local implicits blended near the data, winding number elsewhere."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import _kernels
from .rules import RuleBase

SUPPORTED = (0.02, 0.3)
"""Support below which the far field speaks alone, and above which the local implicits do."""


class Field:
    """Signed distance-like function, negative inside, defined everywhere.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    n_threads : int
        Threads.
    """

    def __init__(self, rules: RuleBase, n_threads: int) -> None:
        self.rules = rules
        self.n_threads = n_threads
        self._tree = _kernels.KdTree(rules.centers, n_threads)
        self._frames = np.ascontiguousarray(rules.frames)
        self._coefficients = np.ascontiguousarray(rules.coefficients)
        feet = rules.feet
        weight = cell_areas(feet, rules.normals, n_threads)
        self._dipoles = weight[:, None] * rules.normals
        self._far_tree = _kernels.WindingTree(feet, weight)
        self._width = float(np.median(rules.radius))
        # As in Poisson reconstruction the level is the mean over the samples: 1/2 on closed data.
        self.level = float(np.average(self.winding_number(feet), weights=weight))

    def winding_number(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Winding number of the oriented rules at `x`, (m,)."""
        width = np.full(len(x), 0.5 * self._width)
        return np.asarray(
            self._far_tree.evaluate(self._dipoles, None, x, width, 0.4, self.n_threads)[0]
        )

    def __call__(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Evaluate the field.

        Parameters
        ----------
        x : (m, 3) float64
            Places, best in an order in which neighbours are close.

        Returns
        -------
        values : (m,) float64
            Negative inside, in the unit of the points.
        support : (m,) float64
            1 on the data, 0 far away from it.
        """
        local, support = _kernels.evaluate_field(
            self._tree,
            x,
            self.rules.centers,
            self._frames,
            self._coefficients,
            self.rules.radius,
            self.rules.tolerance,
            self.rules.quality,
            min(12, len(self.rules)),
            self.n_threads,
        ).T
        low, high = SUPPORTED
        share = np.clip((support - low) / (high - low), 0.0, 1.0)
        share = share * share * (3.0 - 2.0 * share)
        values = np.array(local)
        far = np.flatnonzero(share < 1.0)
        if len(far):
            distance = self._width * (
                self.level - self.winding_number(np.ascontiguousarray(x[far]))
            )
            values[far] = share[far] * local[far] + (1.0 - share[far]) * distance
        return values, np.asarray(support)


def cell_areas(
    feet: NDArray[np.float64], normals: NDArray[np.float64], n_threads: int
) -> NDArray[np.float64]:
    """Area of surface around each rule, from the distance of its neighbours on the same sheet.

    Parameters
    ----------
    feet, normals : (r, 3) float64
        Positions and unit normals.
    n_threads : int
        Threads.

    Returns
    -------
    (r,) float64
        ``pi r_k^2 / k`` with the k nearest.
    """
    k = min(9, len(feet))
    distance, _ = _kernels.KdTree(feet, n_threads).query(feet, k, np.inf, n_threads)
    return np.asarray(np.pi * distance[:, -1] ** 2 / max(k - 0.5, 1.0))
