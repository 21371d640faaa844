"""Clouds that are no surface are said to be none; surfaces, noisy or rough, are not."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import box, torus

from o3d_sofnn import pipeline
from o3d_sofnn._kernels import KdTree
from o3d_sofnn.sampling.suitability import FILLED, volume_share


def uniform(count, sides):
    return np.random.default_rng(0).uniform(-1.0, 1.0, (count, 3)) * sides


def mask(inside, size=14):
    lattice = np.stack(np.meshgrid(*[np.arange(float(size))] * 3), -1).reshape(-1, 3)
    return lattice[inside(lattice - 0.5 * (size - 1))]


VOLUMES = {
    "cube": lambda: uniform(5000, 1.0),
    "small cube": lambda: uniform(600, 1.0),
    "cylinder": lambda: (lambda x: x[np.hypot(x[:, 1], x[:, 2]) < 1.0])(uniform(8000, (3, 1, 1))),
    "voxels of a block": lambda: mask(lambda x: np.ones(len(x), bool)),
    "voxels of a ball": lambda: mask(lambda x: np.linalg.norm(x, axis=1) < 6.5),
}
SURFACES = {
    "box": lambda: box(5000).points,
    "torus with noise": lambda: torus(8000, 1.0, 0.25).noisy(0.02).points,
    "plate": lambda: box(4000, (1.0, 1.0, 0.02)).points,
    "terrain": lambda: (lambda x: np.c_[x[:, :2], 0.1 * np.sin(9.0 * x[:, 0])])(uniform(4000, 1.0)),
}


def share(points):
    return volume_share(points, KdTree(points, 1))


@pytest.mark.parametrize("name", VOLUMES)
def test_volumes_are_said_to_be_volumes(name):
    points = VOLUMES[name]()
    assert share(points) > 1.2 * FILLED
    assert any("fill a volume" in text for text in pipeline.estimate_normals(points).warnings)


@pytest.mark.parametrize("name", SURFACES)
def test_surfaces_are_not(name):
    points = SURFACES[name]()
    assert share(points) < 0.5 * FILLED
    assert not any("fill a volume" in text for text in pipeline.estimate_normals(points).warnings)


def test_a_surface_between_a_few_points_is_a_guess():
    corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    assert any("only 8 points" in text for text in pipeline.reconstruct_surface(corners).warnings)
    assert not any(
        "a guess" in text for text in pipeline.estimate_normals(box(100).points).warnings
    )
