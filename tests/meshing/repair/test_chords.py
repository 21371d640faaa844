"""Triangles lie on bent surfaces in the mean; edges and planes stay as they are."""

from __future__ import annotations

import numpy as np
import pytest

from o3d_sofnn.geometry.mesh_properties import signed_volume
from o3d_sofnn.meshing.isosurface.extraction import extract
from o3d_sofnn.meshing.repair.relaxation import balance_chords

SEEDS = np.concatenate([np.eye(3), -np.eye(3)])


def ball(x):
    return np.linalg.norm(x, axis=1) - 1.0, np.ones(len(x))


def cube(x):
    return abs(x).max(axis=1) - 1.0, np.ones(len(x))


@pytest.fixture(scope="module")
def inscribed():
    vertices, triangles = extract(ball, SEEDS, 0.1)
    return vertices / np.linalg.norm(vertices, axis=1)[:, None], triangles


def test_a_ball_keeps_its_volume(inscribed):
    vertices, triangles = inscribed
    exact = 4.0 / 3.0 * np.pi
    before = signed_volume(vertices, triangles)
    after = signed_volume(balance_chords(vertices, triangles, 1.0), triangles)
    assert abs(after - exact) < 0.35 * abs(before - exact)


def test_triangles_come_nearer_on_either_side(inscribed):
    vertices, triangles = inscribed
    for sign in (1.0, -1.0):
        wound = triangles if sign > 0.0 else np.ascontiguousarray(triangles[:, ::-1])
        moved = balance_chords(vertices, wound, 1.0)
        weights = np.random.default_rng(0).dirichlet(np.ones(3), len(wound))[:, :, None]
        before, after = ((weights * x[wound]).sum(axis=1) for x in (vertices, moved))
        assert abs(ball(after)[0]).mean() < 0.65 * abs(ball(before)[0]).mean()


def test_no_share_moves_nothing(inscribed):
    np.testing.assert_array_equal(balance_chords(*inscribed, 0.0), inscribed[0])


def test_planes_and_edges_stay():
    vertices, triangles = extract(cube, SEEDS, 0.1)
    np.testing.assert_allclose(balance_chords(vertices, triangles, 1.0), vertices, atol=2e-3)
    flat = (abs(vertices) < 0.75).sum(axis=1) == 2
    moved = balance_chords(vertices, triangles, 1.0)
    np.testing.assert_allclose(moved[flat], vertices[flat], atol=1e-12)
