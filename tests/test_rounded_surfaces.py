"""Surfaces of clouds whose coordinates were rounded."""

from __future__ import annotations

import numpy as np
import pytest
from depth_scenes import frame
from mesh_checks import assert_valid_mesh
from scipy.spatial.transform import Rotation
from shapes import box, sphere, torus

from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.pipeline import estimate_normals, reconstruct_surface

TURN = Rotation.from_euler("xyz", (0.3, 0.5, 0.7)).as_matrix()


def off_torus(x):
    ring = np.hypot(np.hypot(x[:, 0], x[:, 1]) - 1.0, x[:, 2])
    return np.abs(ring - 0.4)


def off_box(x):
    out = np.abs(x) - 0.5
    outside = np.linalg.norm(np.maximum(out, 0.0), axis=1)
    return np.abs(outside + np.minimum(out.max(axis=1), 0.0))


def off_sphere(x):
    return np.abs(np.linalg.norm(x, axis=1) - 1.0)


SHAPES = {
    "torus": (torus(6000), 4.0 * np.pi**2 * 0.4, off_torus),
    "box": (box(6000), 6.0, off_box),
    "sphere": (sphere(6000), 4.0 * np.pi, off_sphere),
}
"""Shape, area, distance from it."""


def rounded(points, step):
    step = np.broadcast_to(np.asarray(step, float), 3)
    safe = np.where(step > 0.0, step, 1.0)
    return np.where(step > 0.0, np.round(points / safe) * safe, points)


@pytest.mark.parametrize("step", [0.5, 2.0, (0.0, 0.0, 2.0), (0.0, 0.0, 4.0), (4.0, 4.0, 0.0)])
@pytest.mark.parametrize("name", SHAPES)
def test_surfaces_are_as_near_as_the_step_allows(name, step):
    shape, area, off = SHAPES[name]
    step = np.asarray(step) * np.sqrt(area / len(shape.points))
    points = rounded(shape.points @ TURN.T, step)
    estimate = reconstruct_surface(points, n_threads=2)
    assert_valid_mesh(estimate.vertices, estimate.triangles, components=1)
    places = mesh_properties.sample_surface(estimate.vertices, estimate.triangles, 5000)[0]
    assert off(places @ TURN).mean() < 0.15 * np.max(step)


def test_sides_survive_layers():
    shape = SHAPES["torus"][0]
    deep = rounded(shape.points, (0.0, 0.0, 0.2))
    normals = estimate_normals(deep, n_threads=2).normals
    assert (np.einsum("nd,nd->n", normals, shape.normals) < 0.0).mean() < 0.01


def test_threads_do_not_matter():
    deep = rounded(SHAPES["torus"][0].points[:3000], (0.0, 0.0, 0.3))
    one, two = (reconstruct_surface(deep, n_threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.vertices, two.vertices)
    np.testing.assert_array_equal(one.normals.noise, two.normals.noise)


def test_depth_in_steps_of_disparity_gives_a_smooth_wall():
    seen = frame().noisy(0.0004).quantised(0.008)
    estimate = reconstruct_surface(seen.points, viewpoint=np.zeros(3), trim="auto", n_threads=2)
    step = 0.008 * 2.2**2
    wall = ~seen.on_ball
    assert np.median(estimate.normals.noise[wall]) == pytest.approx(step / np.sqrt(12.0), rel=0.3)
    tilt = estimate.normals.normals[wall] @ [0.0, 0.0, -1.0]
    assert np.mean(np.degrees(np.arccos(np.clip(tilt, -1.0, 1.0)))) < 8.0
