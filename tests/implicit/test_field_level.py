"""The level of the winding number at which the surface is."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_checks import assert_no_intersections
from shapes import sphere

from o3d_sofnn import pipeline
from o3d_sofnn._kernels import nearest_triangles
from o3d_sofnn.implicit.far_field import LONE, FarField

BALL = sphere(3000)
SPACING = np.sqrt(4.0 * np.pi / 3000)


def field(points, normals, solid=True):
    """Far field of points on the ball and beside it."""
    spacing = np.full(len(points), SPACING)
    return FarField.of(points, normals, spacing, np.full(len(points), solid))


def level(points, normals):
    return field(points, normals).level.typical


def test_a_few_points_far_away_do_not_decide_it():
    plain = level(BALL.points, BALL.normals)
    assert plain == pytest.approx(0.5, abs=0.05)
    rng = np.random.default_rng(0)
    clump = np.array([30.0, 0.0, 0.0]) + 0.02 * SPACING * rng.normal(size=(5, 3))
    normals = np.tile([1.0, 0.0, 0.0], (5, 1))
    both = np.concatenate([BALL.points, clump]), np.concatenate([BALL.normals, normals])
    # Each of the five has a neighbour on the ball among its nine: without a limit they weigh a
    # thousand times as much as all of the ball.
    heaviest = 5.0 * (LONE * SPACING) ** 2
    assert heaviest < 0.2 * 4.0 * np.pi
    assert level(*both) == pytest.approx(plain, abs=0.1)


def test_solids_have_one_level_and_shells_within_each_other_one_each():
    inner = np.concatenate([BALL.points, 0.3 * BALL.points])
    inward = -np.concatenate([BALL.normals, BALL.normals])
    both = field(inner, inward, solid=False)
    # Inside of the inner shell the winding number is -2, between them -1.
    np.testing.assert_allclose(both.level_at(BALL.points), -0.5, atol=0.15)
    np.testing.assert_allclose(both.level_at(0.3 * BALL.points), -1.5, atol=0.25)
    assert field(inner, inward).level_at(BALL.points) == level(inner, inward)
    assert field(BALL.points, BALL.normals, solid=False).level_at(BALL.points) == level(
        BALL.points, BALL.normals
    )


@pytest.mark.parametrize(("radius", "top"), [(0.3, 0.0), (0.5, 0.2), (0.3, -0.4)])
def test_what_stands_near_to_a_scanner_is_there_as_the_walls_are(radius, top):
    shell = BALL.points[BALL.points[:, 2] < top] * radius
    points = np.concatenate([sphere(6000).points, shell])
    surface = pipeline.reconstruct_surface(points, viewpoint=np.zeros(3))
    assert_no_intersections(surface.vertices, surface.triangles)
    distance = nearest_triangles(surface.vertices, surface.triangles, shell, 1)[0]
    assert np.quantile(distance, 0.95) < 0.2 * SPACING * radius
    assert surface.quality.near > 0.99
