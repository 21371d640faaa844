"""Random shapes from which the off-line rules are learned."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Mesh(NamedTuple):
    """Vertices (v, 3) and triangles (t, 3), wound so that normals point outwards."""

    vertices: Array
    triangles: Indices


def superquadric(rng: np.random.Generator) -> Mesh:
    """Draw an ellipsoid between a ball, a pillow, a cylinder and a box."""
    east, north = rng.uniform(0.3, 1.4, 2)
    turn, rise = np.linspace(0.0, 2.0 * np.pi, 161)[:-1], np.linspace(-0.5, 0.5, 82)[1:-1] * np.pi
    ring = np.stack([_power(np.cos(turn), east), _power(np.sin(turn), east)], axis=1)
    waist, height = _power(np.cos(rise), north), _power(np.sin(rise), north)
    rings = np.concatenate(
        [waist[:, None, None] * ring, np.tile(height[:, None, None], (1, len(turn), 1))], axis=2
    )
    return _closed(rings, rng.uniform(0.3, 1.0, 3))


def bumpy_ball(rng: np.random.Generator) -> Mesh:
    """Draw a ball with a wavy radius, with fine or visible triangles."""
    fine = int(rng.integers(20, 120))
    turn = np.linspace(0.0, 2.0 * np.pi, 2 * fine + 1)[:-1]
    rise = np.linspace(-0.5, 0.5, fine + 2)[1:-1] * np.pi
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    x = np.concatenate(
        [
            np.cos(rise)[:, None, None] * ring,
            np.tile(np.sin(rise)[:, None, None], (1, len(turn), 1)),
        ],
        axis=2,
    )
    radius = np.ones(x.shape[:2])
    for _ in range(7):
        wave = rng.normal(size=3)
        wave *= rng.uniform(3.0, 18.0) / np.linalg.norm(wave)
        radius += 0.35 / np.linalg.norm(wave) * np.sin(x @ wave + rng.uniform(0.0, 6.3))
    return _closed(radius[:, :, None] * x, rng.uniform(0.5, 1.0, 3))


def turned(rng: np.random.Generator) -> Mesh:
    """Draw a turned part: steps and cones with sharp circular edges."""
    steps = int(rng.integers(3, 7))
    radius = np.repeat(rng.uniform(0.15, 0.6, steps), 2) * rng.uniform(0.85, 1.0, 2 * steps)
    height = np.repeat(np.cumsum(rng.uniform(0.1, 0.4, steps + 1)), 2)[1:-1]
    turn = np.linspace(0.0, 2.0 * np.pi, 161)[:-1]
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rings = np.concatenate(
        [radius[:, None, None] * ring, np.tile(height[:, None, None], (1, len(turn), 1))], axis=2
    )
    return _closed(rings, np.ones(3))


def tube(rng: np.random.Generator) -> Mesh:
    """Draw an arm along a curve that becomes thinner towards its ends."""
    along = np.linspace(0.0, 1.0, 242)[1:-1]
    curve = sum(
        rng.normal(size=3)
        * 0.5
        / wave
        * np.sin(np.pi * wave * along + rng.uniform(0.0, 6.3))[:, None]
        for wave in (0.7, 1.4, 2.1)
    )
    curve = np.asarray(curve) + along[:, None] * [1.5, 0.0, 0.0]
    tangent = np.gradient(curve, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, [0.0, 0.6, 0.8])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(tangent, side)
    thin, thick = rng.uniform(0.01, 0.05), rng.uniform(0.05, 0.15)
    radius = (thin + (thick - thin) * np.sin(np.pi * along)) * (1.0 - (2.0 * along - 1.0) ** 40)
    turn = np.linspace(0.0, 2.0 * np.pi, 41)[:-1]
    flat = rng.uniform(0.4, 1.0)
    circle = np.cos(turn)[None, :, None] * side[:, None] + flat * (
        np.sin(turn)[None, :, None] * other[:, None]
    )
    return _closed(curve[:, None] + radius[:, None, None] * circle, np.ones(3))


def polyhedron(rng: np.random.Generator) -> Mesh:
    """Draw the convex hull of a few points."""
    points = rng.normal(size=(int(rng.integers(8, 24)), 3))
    points *= (rng.uniform(0.7, 1.0, len(points)) / np.linalg.norm(points, axis=1))[:, None]
    points *= rng.uniform(0.4, 1.0, 3)
    hull = ConvexHull(points)
    a, b, c = points[hull.simplices].transpose(1, 0, 2)
    inwards = np.einsum("td,td->t", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    triangles = hull.simplices.astype(np.int64)
    triangles[inwards] = triangles[inwards][:, ::-1]
    return Mesh(points, triangles)


def star_prism(rng: np.random.Generator) -> Mesh:
    """Draw a star with straight sides: sharp ridges and sharp valleys."""
    corners = 2 * int(rng.integers(3, 9))
    angle = (np.arange(corners) + rng.uniform(-0.3, 0.3, corners)) * 2.0 * np.pi / corners
    radius = np.where(np.arange(corners) % 2, rng.uniform(0.4, 0.9), 1.0)
    height = rng.uniform(0.15, 1.0)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius[:, None]
    rings = np.zeros((2, corners, 3))
    rings[:, :, :2] = ring
    rings[1, :, 2] = height
    return _closed(rings, np.ones(3))


def box(rng: np.random.Generator) -> Mesh:
    """Draw a box."""
    return _box(rng.uniform(0.3, 1.0, 3))


def plate(rng: np.random.Generator) -> Mesh:
    """Draw a thin plate."""
    return _box(np.append(rng.uniform(0.6, 1.0, 2), rng.uniform(0.02, 0.07)))


SHAPES: tuple[Callable[[np.random.Generator], Mesh], ...] = (
    superquadric,
    bumpy_ball,
    turned,
    tube,
    polyhedron,
    star_prism,
    box,
    plate,
)


def draw(
    mesh: Mesh, count: int, noise: float, uneven: float, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Draw noisy points and the true normals of the places they come from.

    Parameters
    ----------
    mesh : Mesh
        The shape.
    count : int
        Number of points.
    noise : float
        Standard deviation along each axis, divided by the diagonal of the bounding box.
    uneven : float
        Logarithm of the ratio of the densities at both ends.
    rng : Generator
        Source of random numbers.

    Returns
    -------
    points, normals : (count, 3) float64
    """
    a, b, c = mesh.vertices[mesh.triangles].transpose(1, 0, 2)
    cross = np.cross(b - a, c - a)
    area = np.linalg.norm(cross, axis=1)
    drawn = rng.choice(len(area), 4 * count, p=area / area.sum())
    u, v = rng.uniform(size=(2, 4 * count, 1))
    u, v = np.where(u + v > 1.0, 1.0 - u, u), np.where(u + v > 1.0, 1.0 - v, v)
    points = a[drawn] + u * (b - a)[drawn] + v * (c - a)[drawn]
    place = points @ (lambda way: way / np.linalg.norm(way))(rng.normal(size=3))
    share = np.exp(uneven * (place - place.min()) / np.ptp(place))
    keep = rng.choice(4 * count, count, replace=False, p=share / share.sum())
    diagonal = float(np.linalg.norm(np.ptp(mesh.vertices, axis=0)))
    points = points[keep] + rng.normal(0.0, noise * diagonal, (count, 3))
    return points, (cross / np.maximum(area, 1e-300)[:, None])[drawn[keep]]


def _box(size: Array) -> Mesh:
    corners = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    faces = [
        (0, 1, 3, 2),
        (4, 6, 7, 5),
        (0, 4, 5, 1),
        (2, 3, 7, 6),
        (0, 2, 6, 4),
        (1, 5, 7, 3),
    ]
    triangles = [corner for p, q, r, s in faces for corner in ((p, q, r), (p, r, s))]
    return Mesh(corners * size, np.array(triangles, np.int64))


def _closed(rings: Array, size: Array) -> Mesh:
    """Join rings (m, k, 3), counterclockwise seen from the last one, and close both ends."""
    m, k = rings.shape[:2]
    ends = np.stack([rings[0].mean(axis=0), rings[-1].mean(axis=0)])
    row, column = np.meshgrid(np.arange(m - 1), np.arange(k), indexing="ij")
    after = (column + 1) % k
    low, right = (row * k + column).ravel(), (row * k + after).ravel()
    up, both = low + k, right + k
    sides = np.concatenate(
        [np.stack([low, right, both], axis=1), np.stack([low, both, up], axis=1)]
    )
    i = np.arange(k)
    j = (i + 1) % k
    first = np.stack([np.full(k, m * k), j, i], axis=1)
    last = np.stack([np.full(k, m * k + 1), (m - 1) * k + i, (m - 1) * k + j], axis=1)
    vertices = np.concatenate([rings.reshape(-1, 3), ends]) * size
    return Mesh(vertices, np.concatenate([sides, first, last]))


def _power(x: Array, exponent: float) -> Array:
    return np.asarray(np.sign(x) * np.abs(x) ** exponent)
