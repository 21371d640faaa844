"""Sides of normals, from positions alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from shapes import (
    Shape,
    box,
    inside_out,
    join,
    nested_spheres,
    plane_patch,
    sphere,
    torus,
    two_spheres,
)

from o3d_sofnn.orientation import face, pieces, turn_along
from o3d_sofnn.pipeline import estimate_normals
from o3d_sofnn.reference.local_fit import frame_of
from o3d_sofnn.rules import RuleBase


def rules_on(shape, seed=0):
    """Flat rules on exact positions, sides of their normals drawn at random."""
    n = len(shape.points)
    side = np.random.default_rng(seed).choice([-1.0, 1.0], (n, 1))
    reach = cKDTree(shape.points).query(shape.points, min(20, n))[0][:, -1]
    return RuleBase(
        centers=shape.points,
        frames=np.array([frame_of(normal) for normal in side * shape.normals]),
        coefficients=np.zeros((n, 6)),
        radius=1.1 * reach,
        residual=np.zeros(n),
        noise=np.zeros(n),
        n_neighbors=np.full(n, 20),
        confidence=np.ones(n),
    )


def flipped(normals, shape):
    return float(((normals * shape.normals).sum(axis=1) < 0.0).mean())


SHAPES = {
    "sphere": sphere(1000),
    "torus": torus(1500),
    "box": box(1500),
    "nested spheres": nested_spheres(1500),
    "two objects": two_spheres(1500),
    "two close objects": two_spheres(3000, 2.4),
    "thin plate": box(3000, (1.0, 1.0, 0.1)),
}


@pytest.mark.parametrize("name", ["torus", "thin plate"])
def test_sides_of_points_follow_turned_rules(name):
    shape = SHAPES[name]
    rules = rules_on(shape).facing(shape.normals)
    left = shape.points[:, 0] < 0.0
    side = np.where(left, -1.0, 1.0)[:, None] * shape.normals
    none, every = np.zeros(len(side), bool), np.ones(len(side), bool)
    turned = turn_along(shape.normals, shape.points, rules, rules.facing(side), none, 1)
    np.testing.assert_array_equal(turned, side)
    assert turn_along(side, shape.points, rules, rules, none, 1) is side
    followed = turn_along(side, shape.points, rules, rules, every, 1)
    np.testing.assert_array_equal(followed, shape.normals)


@pytest.mark.parametrize(("noise", "bound"), [(0.0, 0.0), (0.005, 0.0), (0.02, 0.002)])
@pytest.mark.parametrize("name", SHAPES)
def test_normals_of_points_face_outwards(name, noise, bound):
    # A plate of 0.1 with a noise of 0.02 has points of one side beyond the middle.
    limit = {0.0: 0.0, 0.005: 0.001, 0.02: 0.02}[noise] if name == "thin plate" else bound
    shape = SHAPES[name]
    normals = estimate_normals(shape.noisy(noise).points, n_threads=1).normals
    assert flipped(normals, shape) <= limit


def test_sheets_one_fiftieth_apart_are_told_apart():
    shape = box(20_000, (1.0, 1.0, 0.02))
    assert flipped(estimate_normals(shape.points, n_threads=1).normals, shape) < 0.002


def bowl(n):
    """The lower half of a sphere, open."""
    shape = sphere(2 * n)
    low = shape.points[:, 2] < 0.0
    return shape._replace(points=shape.points[low], normals=shape.normals[low])


def hills(n):
    """A wavy sheet over a square."""
    x, y, _ = plane_patch(n, 4.0).points.T
    points = np.stack([x, y, 0.2 * np.sin(3.0 * x) * np.cos(3.0 * y)], axis=1)
    slope_x = 0.6 * np.cos(3.0 * x) * np.cos(3.0 * y)
    slope_y = -0.6 * np.sin(3.0 * x) * np.sin(3.0 * y)
    normals = np.stack([-slope_x, -slope_y, np.ones(n)], axis=1)
    return Shape(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("sheet", [plane_patch(2000), hills(4000), bowl(1500)])
def test_open_sheets_have_one_side(sheet, noise):
    found = flipped(estimate_normals(sheet.noisy(noise).points, n_threads=1).normals, sheet)
    assert min(found, 1.0 - found) == 0.0


def test_far_objects_of_different_size_are_both_oriented():
    shape = join(sphere(1500), sphere(1500, radius=0.2, seed=1).moved((20.0, 0.0, 0.0)))
    assert flipped(estimate_normals(shape.points, n_threads=1).normals, shape) == 0.0


def test_pieces_are_the_connected_parts():
    label = pieces(rules_on(two_spheres(1000)), 1)
    assert len(np.unique(label)) == 2
    assert len(np.unique(label[:500])) == 1
    assert len(np.unique(label[500:])) == 1
    assert len(np.unique(pieces(rules_on(torus(1000)), 1))) == 1


def test_normals_face_a_viewpoint():
    shape = plane_patch(400)
    viewpoint = np.array([0.2, 0.1, -3.0])
    turned = face(rules_on(shape), viewpoint, None, 1)
    assert (turned.normals[:, 2] < 0.0).all()


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_every_piece_faces_a_direction_in_the_mean(direction):
    up, down = plane_patch(400), inside_out(plane_patch(400, seed=1).moved((3.0, 0.0, 0.0)))
    rules = rules_on(join(up, down)).facing(join(up, down).normals)
    turned = face(rules, None, np.array([0.0, 0.0, direction]), 1)
    assert (turned.normals[:, 2] * direction > 0.0).all()


def test_without_wishes_rules_stay():
    rules = rules_on(sphere(100))
    assert face(rules, None, None, 1) is rules


def test_turned_rules_describe_the_same_surface():
    rng = np.random.default_rng(0)
    rules = replace(rules_on(sphere(50)), coefficients=rng.normal(0.0, 0.3, (50, 6)))
    turned = rules.facing(-rules.normals)
    np.testing.assert_allclose(turned.normals, -rules.normals, atol=1e-12)
    np.testing.assert_allclose(turned.feet, rules.feet, atol=1e-12)
    np.testing.assert_allclose(turned.curvatures, -rules.curvatures[:, ::-1], atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turned.frames), 1.0, atol=1e-12)
