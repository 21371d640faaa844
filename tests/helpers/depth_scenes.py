"""A ball before a wall, as a depth camera or a scanner at the origin sees it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

BALL, RADIUS, WALL = np.array([0.0, 0.0, 1.5]), 0.3, 2.2
"""The camera looks along z."""


class Frame(NamedTuple):
    """Points of a frame, row by row, which of them are on the ball, and the unit rays."""

    points: NDArray[np.float64]
    on_ball: NDArray[np.bool_]
    rays: NDArray[np.float64]

    def stretched(self, factor: NDArray[np.float64]) -> Frame:
        """Move every point along its ray."""
        return self._replace(points=self.points * factor[:, None])

    def noisy(self, sigma: float, seed: int = 0) -> Frame:
        """Add noise along the rays that grows with the square of the depth, sigma at 1."""
        depth = self.points[:, 2]
        deviate = np.random.default_rng(seed).normal(0.0, sigma, len(depth))
        return self.stretched(1.0 + deviate * depth)

    def quantised(self, step: float) -> Frame:
        """Round depths to steps of disparity, `step` long at a depth of 1."""
        depth = self.points[:, 2]
        return self.stretched(1.0 / (np.round(1.0 / (depth * step)) * step * depth))

    def mixed(self, share: float, seed: int = 1) -> tuple[Frame, NDArray[np.bool_]]:
        """Put a share of the rays that just miss the ball between it and the wall; which, too."""
        rng = np.random.default_rng(seed)
        passing = np.linalg.norm(np.cross(self.rays, BALL), axis=1)
        beside = ~self.on_ball & (passing < 1.12 * RADIUS)
        hanging = beside & (rng.random(len(beside)) < share)
        depth = rng.uniform(BALL[2] + 0.1, WALL - 0.1, len(beside))
        factor = np.where(hanging, depth / self.points[:, 2], 1.0)
        return self.stretched(factor), hanging

    def errors(self) -> NDArray[np.float64]:
        """Distances of the points from the ball or the wall, whichever they lie on."""
        ball = np.abs(np.linalg.norm(self.points - BALL, axis=1) - RADIUS)
        return np.where(self.on_ball, ball, np.abs(self.points[:, 2] - WALL))


def frame(width: int = 120, height: int = 90) -> Frame:
    """Return a frame without any error."""
    u, v = np.meshgrid(np.arange(width) - 0.5 * (width - 1), np.arange(height) - 0.5 * (height - 1))
    through = np.stack([u.ravel(), v.ravel(), np.full(u.size, 0.94 * width)], axis=1)
    rays = through / np.linalg.norm(through, axis=1, keepdims=True)
    along = rays @ BALL
    inside = along**2 - BALL @ BALL + RADIUS**2
    on_ball = inside > 0.0
    distance = np.where(on_ball, along - np.sqrt(np.maximum(inside, 0.0)), WALL / rays[:, 2])
    return Frame(rays * distance[:, None], on_ball, rays)
