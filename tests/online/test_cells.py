"""Cells that absorb points."""

import numpy as np
import pytest
from shapes import sphere

from o3d_sofnn.online.cells import Cells, edge_for

POINTS = sphere(3000).points


def test_a_cell_keeps_the_mean_of_its_points():
    points = np.array([[0.1, 0.2, 0.3], [0.3, 0.2, 0.1], [-0.1, 0.0, 0.0]])
    cells = Cells.of(points, 0.5)
    assert cells.count.tolist() == [1, 2]
    np.testing.assert_allclose(cells.points, [[-0.1, 0.0, 0.0], [0.2, 0.2, 0.2]], atol=1e-15)
    assert cells.viewpoint is None


@pytest.mark.parametrize("parts", [2, 7])
def test_order_and_parts_do_not_matter(parts):
    whole = Cells.of(POINTS, 0.05)
    order = np.random.default_rng(0).permutation(len(POINTS))
    sweeps = [Cells.of(POINTS[rows], 0.05) for rows in np.array_split(order, parts)]
    found = sweeps[0]
    for sweep in sweeps[1:]:
        found = found.joined(sweep)
    np.testing.assert_array_equal(found.keys, whole.keys)
    np.testing.assert_array_equal(found.count, whole.count)
    np.testing.assert_allclose(found.points, whole.points, rtol=0.0, atol=1e-15)


def test_what_arrives_again_adds_weight_alone():
    once = Cells.of(POINTS, 0.05)
    again = once
    for _ in range(9):
        again = again.joined(once)
    assert len(again) == len(once)
    np.testing.assert_allclose(again.points, once.points, rtol=0.0, atol=1e-14)
    np.testing.assert_array_equal(again.count, 10 * once.count)


def test_far_from_the_origin_nothing_is_lost():
    far = np.array([5.1e5, 4.2e6, 300.0])
    np.testing.assert_allclose(
        Cells.of(POINTS + far, 2.0**-5).points - far,
        Cells.of(POINTS + far - far, 2.0**-5).points,
        atol=2.0**-5,
    )
    assert np.abs(Cells.of(POINTS + far, 2.0**-20).points - far).max() < 1.1


def test_viewpoints_are_known_where_all_points_have_one():
    seen = Cells.of(POINTS, 0.05, np.array([0.0, 0.0, 9.0]))
    np.testing.assert_allclose(seen.viewpoint, np.tile([0.0, 0.0, 9.0], (len(seen), 1)))
    own = Cells.of(POINTS, 0.05, 3.0 * POINTS)
    np.testing.assert_allclose(own.viewpoint, 3.0 * own.points, atol=0.15)
    assert seen.joined(Cells.of(POINTS + 5.0, 0.05)).viewpoint is None


def test_a_box_takes_cells_away():
    cells = Cells.of(POINTS, 0.05)
    left = cells.without(np.array([-2.0, -2.0, 0.0]), np.array([2.0, 2.0, 2.0]))
    assert 0.4 < len(left) / len(cells) < 0.6
    assert (left.points[:, 2] < 0.0).all()


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_the_edge_is_a_power_of_two_below_the_spacing(scale):
    edge = edge_for(scale * POINTS)
    spacing = scale * np.sqrt(4.0 * np.pi / len(POINTS))
    assert np.log2(edge) == np.rint(np.log2(edge))
    assert 0.15 * spacing < edge < 0.6 * spacing


def test_a_single_place_has_no_edge():
    with pytest.raises(ValueError, match="pcd: expected at least two"):
        edge_for(np.ones((9, 3)))
