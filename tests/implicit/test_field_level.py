"""The level of the winding number at which the surface is."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import sphere

from o3d_sofnn import pipeline
from o3d_sofnn._kernels import KdTree
from o3d_sofnn.implicit.field import LONE, Field
from o3d_sofnn.implicit.units import local_surfaces

BALL = sphere(3000)
SPACING = np.sqrt(4.0 * np.pi / 3000)


def level(points, normals):
    """Level of a field whose rules are those of the ball alone."""
    rules = pipeline.estimate_normals(BALL.points, n_threads=1).rules
    tree = KdTree(points, 1)
    _, surfaces = local_surfaces(rules, points, normals, tree, 1, None)
    return Field(rules, surfaces, points, normals, np.full(len(points), SPACING), 1).level


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
