"""Figures of a run: from what the tiles say, whatever their order and number."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from o3d_sofnn.implicit.far_field import Level
from o3d_sofnn.meshing.isosurface.grid import MARGIN
from o3d_sofnn.options import Options
from o3d_sofnn.tiles.learning import Figures, run_of, weighted_median

SIDES = SimpleNamespace(level=Level(0.5, np.zeros((0, 3)), np.zeros(0)))


def figures(points, low, high, spacing=1.0):
    one = np.ones(100)
    return Figures(
        5.0 * one, 3.0 * one, spacing * one, 0.5 * one, points / 100.0, points, low, high
    )


LEFT = figures(40_000, np.zeros(3), np.array([200.0, 200.0, 1.0]))


RIGHT = figures(40_000, np.array([200.0, 0.0, -1.0]), np.array([400.0, 200.0, 0.5]))


@pytest.mark.parametrize("options", [Options(), Options(voxel_size=2.0), Options(depth=7)])
def test_the_wall_is_several_usual_cubes_away(options):
    run = run_of([LEFT, RIGHT], SIDES, options)
    usual = run.lattice.size * 2.0**run.lattice.usual
    np.testing.assert_allclose(run.low, np.array([0.0, 0.0, -1.0]) - MARGIN * usual)
    np.testing.assert_allclose(run.high, np.array([400.0, 200.0, 1.0]) + MARGIN * usual)


def test_the_user_may_choose_the_cubes():
    assert run_of([LEFT], SIDES, Options(voxel_size=2.0)).lattice.size == 2.0
    assert run_of([LEFT, RIGHT], SIDES, Options(depth=7)).lattice.size == 400.0 / 2**7


def test_tiles_have_weight_by_their_points():
    few = figures(100, np.zeros(3), np.array([400.0, 200.0, 1.0]), spacing=9.0)
    both = run_of([LEFT, RIGHT], SIDES, Options())
    assert run_of([LEFT, RIGHT, few], SIDES, Options()).lattice == both.lattice
    assert run_of([RIGHT, LEFT], SIDES, Options()).lattice == both.lattice


def test_half_of_the_weight_is_below_the_median():
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.array([1.0, 1.0, 1.0])) == 2.0
    assert weighted_median(np.array([3.0, 1.0, 2.0]), np.array([5.0, 1.0, 1.0])) == 3.0
