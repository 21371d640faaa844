"""Rules drawn at random, and fitted ones, as the native kernels take them."""

from __future__ import annotations

import numpy as np
from shapes import torus

from o3d_sofnn import _kernels, reference
from o3d_sofnn.meshing.isosurface.extraction import extract
from o3d_sofnn.reference.sampling.local_fit import frame_of

MIRROR = np.array([-1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
"""Signs of the coefficients when the normal and the second tangent of a frame change sides."""


def random_rules(n=300, seed=0):
    """Rules on a torus, their quadrics and widths drawn at random."""
    rng = np.random.default_rng(seed)
    centers, normals = torus(n, seed=seed)
    frames = np.array([frame_of(normal) for normal in normals])
    coefficients = rng.normal(0.0, 0.2, (n, 6))
    radius = rng.uniform(0.2, 0.5, n)
    stretch = rng.uniform(1.0, 2.0, n)
    tolerance = rng.uniform(0.02, 0.2, n) * radius
    quality = np.where(rng.random(n) < 0.1, 0.0, rng.uniform(0.0, 1.0, n))
    return reference.Rules(centers, frames, coefficients, radius, stretch, tolerance, quality)


def with_trust(rules, m=3, seed=5):
    """The rules with off-line rules drawn at random."""
    rng = np.random.default_rng(seed)
    gates = rng.normal(0.0, 1.0, (len(rules.centers), m, 2))
    return rules._replace(gates=gates, neurons=rng.uniform(0.0, 1.0, (m, 3, 3)))


def view(rules, n_threads=1):
    """The same rules for the kernels."""
    return _kernels.RuleView(*rules, n_threads)


def random_terms(n=300, seed=0):
    """Between none and all of 13 basis functions for each rule."""
    rng = np.random.default_rng(seed)
    return rng.normal(0.0, 0.3, (n, 13, 4)), rng.integers(0, 14, n)


def places_near(rules, seed=1):
    rng = np.random.default_rng(seed)
    near = rules.centers + rng.normal(0.0, 0.1, rules.centers.shape)
    return np.concatenate([near, rng.uniform(-3.0, 3.0, (100, 3)), rules.centers[:20]])


def unit_data(points, normals, tolerance=0.002):
    """Rules fitted to every 15th point, and what belongs to them; the first half decide alone."""
    centers = points[::15]
    n = len(centers)
    tree = _kernels.KdTree(points, 1)
    sizes = np.full(n, 40)
    frames, coefficients, _, radius, _ = _kernels.fit_quadrics(
        tree, points, centers, sizes, np.zeros(n), 0, None, None, None, np.ones(n)
    )
    frames, coefficients = np.array(frames), np.array(coefficients)
    inward = (frames[:, 2] * normals[::15]).sum(axis=1) < 0.0
    frames[inward, 1:] *= -1.0
    coefficients[inward] *= MIRROR
    rules = reference.Rules(centers, frames, coefficients, radius, *np.ones((3, n)))
    own = np.where(np.arange(n) < n // 2, 20, 40)
    return points, normals, rules, sizes, own, np.full(n, tolerance)


def mesh(seed=0):
    """A rough torus and random places near its vertices."""
    points = torus(3000, seed=seed).points

    def ring(x):
        return np.hypot(np.hypot(x[:, 0], x[:, 1]) - 1.0, x[:, 2]) - 0.4, np.ones(len(x))

    vertices, triangles = extract(ring, points, 0.1)
    rng = np.random.default_rng(seed)
    return vertices, triangles, vertices + rng.normal(0.0, 0.03, vertices.shape)
