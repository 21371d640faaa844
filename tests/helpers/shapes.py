"""Points on analytic shapes with their exact outward normals, from a seed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Shape(NamedTuple):
    points: NDArray[np.float64]
    normals: NDArray[np.float64]

    def noisy(self, sigma: float, seed: int = 1) -> Shape:
        """Move every point by a normal deviate of ``sigma``, in units of length."""
        rng = np.random.default_rng(seed)
        return self._replace(points=self.points + rng.normal(0.0, sigma, self.points.shape))

    def moved(self, offset: tuple[float, float, float] | float) -> Shape:
        return self._replace(points=self.points + np.asarray(offset))

    def scaled(self, factor: float) -> Shape:
        return self._replace(points=self.points * factor)


def sphere(n: int = 2000, radius: float = 1.0, seed: int = 0) -> Shape:
    normals = _directions(np.random.default_rng(seed), n)
    return Shape(radius * normals, normals)


def two_spheres(n: int = 4000, distance: float = 5.0, seed: int = 0) -> Shape:
    """Two unit spheres whose centres are ``distance`` apart."""
    left, right = sphere(n // 2, seed=seed), sphere(n - n // 2, seed=seed + 1)
    return join(left, right.moved((distance, 0.0, 0.0)))


def torus(n: int = 4000, major: float = 1.0, minor: float = 0.4, seed: int = 0) -> Shape:
    rng = np.random.default_rng(seed)
    # Area grows with the distance from the axis: draw too many, keep that share.
    tube = rng.uniform(0.0, 2.0 * np.pi, 4 * n + 100)
    keep = rng.uniform(0.0, major + minor, len(tube)) < major + minor * np.cos(tube)
    tube = tube[keep][:n]
    turn = rng.uniform(0.0, 2.0 * np.pi, n)
    normals = np.stack(
        [np.cos(tube) * np.cos(turn), np.cos(tube) * np.sin(turn), np.sin(tube)], axis=1
    )
    circle = np.stack([np.cos(turn), np.sin(turn), np.zeros(n)], axis=1)
    return Shape(major * circle + minor * normals, normals)


def box(n: int = 4000, size: tuple[float, float, float] = (1.0, 1.0, 1.0), seed: int = 0) -> Shape:
    rng = np.random.default_rng(seed)
    sides = np.asarray(size)
    areas = np.prod(sides) / sides
    axis = rng.choice(3, n, p=areas / areas.sum())
    sign = rng.choice([-1.0, 1.0], n)
    normals = np.zeros((n, 3))
    normals[np.arange(n), axis] = sign
    points = rng.uniform(-0.5, 0.5, (n, 3))
    points[np.arange(n), axis] = 0.5 * sign
    return Shape(points * sides, normals)


def plane_patch(n: int = 2000, size: float = 1.0, seed: int = 0) -> Shape:
    """A square in the plane z = 0, normals up."""
    rng = np.random.default_rng(seed)
    points = np.zeros((n, 3))
    points[:, :2] = rng.uniform(-size / 2.0, size / 2.0, (n, 2))
    return Shape(points, np.tile([0.0, 0.0, 1.0], (n, 1)))


def join(*shapes: Shape) -> Shape:
    return Shape(
        np.concatenate([shape.points for shape in shapes]),
        np.concatenate([shape.normals for shape in shapes]),
    )


def angles(normals: NDArray[np.float64], truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angles in degrees, 0 to 180, between unit normals and the true ones."""
    return np.degrees(np.arccos(np.clip((normals * truth).sum(axis=1), -1.0, 1.0)))


def inside_out(shape: Shape) -> Shape:
    return shape._replace(normals=-shape.normals)


def nested_spheres(n: int) -> Shape:
    """A hollow ball: normals of the inner sphere point into the cavity."""
    return join(sphere(n), inside_out(sphere(n // 4, radius=0.5, seed=1)))


def _directions(rng: np.random.Generator, n: int) -> NDArray[np.float64]:
    vectors = rng.normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


CLOSED = {
    "sphere": sphere(1000),
    "torus": torus(1500),
    "box": box(1500),
    "nested spheres": nested_spheres(1500),
    "two objects": two_spheres(1500),
    "two close objects": two_spheres(3000, 2.4),
    "thin plate": box(3000, (1.0, 1.0, 0.1)),
}
