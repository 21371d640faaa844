"""Open sheets that one place sees side by side."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from shapes import Shape, join, plane_patch, sphere

from o3d_sofnn.orientation.single_view import seen_together
from o3d_sofnn.pipeline import estimate_normals


def depth_image(steps=140):
    """What a camera at the origin records: a wall and, in front of it, a bent piece of card."""
    x, y = np.meshgrid(*2 * [np.linspace(-0.5, 0.5, steps)])
    rays = np.column_stack([x.ravel(), y.ravel(), np.ones(steps**2)])
    wall = 2.0 / (1.0 - 0.3 * rays[:, 1])
    slope = np.where(rays[:, 0] < 0.05, -1.0, 1.0)
    card = 1.0 / (1.0 - 0.8 * slope * (rays[:, 0] - 0.05))
    front = np.abs(rays[:, :2] - 0.05).max(axis=1) < 0.2
    normals = np.column_stack([0.8 * slope, np.zeros(steps**2), -1.0 - 0.04 * slope])
    normals = np.where(front[:, None], normals, [0.0, 0.3, -1.0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Shape(rays * np.where(front, card, wall)[:, None], normals), front


def verdict(shape, second, sign=1.0):
    """What is said of the second piece beside the first, its normals turned by `sign`."""
    normals = shape.normals * np.where(second, sign, 1.0)[:, None]
    areas = np.ones(len(normals))
    found = seen_together(shape.points, normals, areas, second.astype(np.int64), 0, 1)
    assert found[0] == 0
    return found[1]


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("turn", [0, 1])
def test_an_object_in_front_of_a_wall_shows_the_same_side(sign, turn):
    scene, front = depth_image(60)
    turned = Rotation.random(rng=turn).as_matrix() if turn else np.eye(3)
    scene = Shape(5.0 * scene.points @ turned.T + 30.0, scene.normals @ turned.T)
    assert verdict(scene, front, sign) == sign
    assert verdict(Shape(scene.points, -scene.normals), front, sign) == sign


@pytest.mark.parametrize("thickness", [0.02, 0.1, 0.2])
@pytest.mark.parametrize("share", [1.0, 0.3])
def test_two_sides_of_a_wall_are_not_seen_together(thickness, share):
    front, back = plane_patch(1500), plane_patch(500, share, seed=1)
    wall = join(front, Shape(back.points - [0.0, 0.0, thickness], -back.normals))
    assert verdict(wall, np.arange(2000) >= 1500) == 0


def test_a_ball_above_the_ground_is_not_seen_from_one_side():
    scene = join(plane_patch(3000, 4.0), sphere(1500, 0.4).moved((0.0, 0.0, 1.0)))
    assert verdict(scene, np.arange(4500) >= 3000) == 0


def test_few_rules_are_not_judged():
    scene, front = depth_image(20)
    assert front.sum() < 100
    assert verdict(scene, front, -1.0) == 0


def test_normals_of_a_depth_image_have_one_side():
    scene, _ = depth_image()
    facing = (estimate_normals(scene.points, n_threads=1).normals * scene.normals).sum(axis=1) > 0
    assert max(facing.mean(), 1.0 - facing.mean()) > 0.995
