"""Moves that make triangles cut others are taken back, and no others."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_checks import assert_no_intersections, assert_valid_mesh
from shapes import box, sphere

from o3d_sofnn.meshing.isosurface.extraction import extract
from o3d_sofnn.meshing.repair.untangling import untangle
from o3d_sofnn.pipeline import reconstruct_surface
from o3d_sofnn.threads import using_threads


@pytest.fixture(scope="module")
def ball():
    return extract(
        lambda x: (np.linalg.norm(x, axis=1) - 1.0, np.ones(len(x))), sphere(3000).points, 0.12
    )


def test_only_what_cuts_goes_back(ball):
    start, triangles = ball
    rng = np.random.default_rng(0)
    near = start[:, 2] > 0.7
    shift = np.where(near[:, None], rng.normal(0.0, 0.08, start.shape), 0.01)
    result = untangle([start, start + shift], triangles)
    assert_no_intersections(result, triangles)
    back = (result == start).all(axis=1)
    np.testing.assert_array_equal(result[~back], (start + shift)[~back])
    assert not back[~near].any()
    assert 0.05 < back[near].mean() < 0.6


def test_one_step_after_the_other(ball):
    start, triangles = ball
    steps = [start, 1.1 * start, 1.1 * start]
    steps[2] = steps[2] + np.random.default_rng(0).normal(0.0, 0.03, start.shape)
    result = untangle(steps, triangles)
    assert_no_intersections(result, triangles)
    stage = np.stack([(result == step).all(axis=1) for step in steps])
    assert stage.any(axis=0).all()
    assert stage[1].any()
    assert not stage[0].any(), "the step before the last one was good enough"


def test_a_step_without_a_move_is_passed_over(ball):
    start, triangles = ball
    wild = start + np.random.default_rng(0).normal(0.0, 0.06, start.shape)
    once, twice = (untangle(steps, triangles) for steps in ([start, wild], [start, wild, wild]))
    assert_no_intersections(once, triangles)
    assert_no_intersections(twice, triangles)


def test_threads_change_nothing(ball):
    start, triangles = ball
    wild = start + np.random.default_rng(0).normal(0.0, 0.06, start.shape)
    with using_threads(1):
        one = untangle([start, wild], triangles)
    with using_threads(3):
        np.testing.assert_array_equal(untangle([start, wild], triangles), one)


def test_good_moves_stay(ball):
    start, triangles = ball
    np.testing.assert_array_equal(untangle([start, 2.0 * start], triangles), 2.0 * start)
    np.testing.assert_array_equal(untangle([start, start], triangles), start)


def noise(points, sigma):
    return points + np.random.default_rng(1).normal(0.0, sigma, points.shape)


CLOUDS = {
    "points within a cube": np.random.default_rng(0).uniform(0.0, 1.0, (1500, 3)),
    "a noisy plate": noise(box(2500, (1.0, 1.0, 0.05)).points, 0.01),
    "a wedge": box(2500).points * np.stack([np.ones(2500)] * 2 + [np.zeros(2500)], axis=1)
    + np.outer(box(2500).points[:, 2] * (box(2500).points[:, 0] + 0.5), [0.0, 0.0, 0.2]),
    "two sheets with bridges": noise(
        np.concatenate([sphere(1500).points, 1.05 * sphere(1500, seed=1).points]), 0.005
    ),
}


@pytest.mark.parametrize("name", CLOUDS)
def test_reconstructed_meshes_do_not_cut_themselves(name):
    surface = reconstruct_surface(CLOUDS[name], closed=True)
    assert_valid_mesh(surface.vertices, surface.triangles)
