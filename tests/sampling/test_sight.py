"""Points that hang between things, as seen from where the scanner stood."""

from __future__ import annotations

import numpy as np
import pytest
from depth_scenes import frame
from scipy.spatial.transform import Rotation

from o3d_sofnn import pipeline
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.sampling.scales.choice import Scale
from o3d_sofnn.sampling.sight import between

ORIGIN = np.zeros(3)
SEEN, HANGING = frame().noisy(0.001).mixed(0.3)


class Even(Scale):
    """One noise level everywhere."""

    def __init__(self, noise):
        object.__setattr__(self, "noise", np.array([noise]))

    def at(self, x):
        return np.zeros(len(x), np.int64)


def test_points_between_ball_and_wall_are_found():
    found = between(SEEN.points, ORIGIN, Even(0.003))
    assert HANGING.sum() > 100
    assert found[HANGING].mean() > 0.88
    assert found[~HANGING].mean() < 0.002


def test_nothing_hangs_in_a_clean_frame():
    clean = frame().noisy(0.001)
    assert between(clean.points, ORIGIN, Even(0.003)).mean() < 0.002


def test_nobody_knows_without_a_viewpoint():
    assert not between(SEEN.points, None, Even(0.003)).any()


@pytest.mark.parametrize("size", [1e-3, 1e4])
def test_place_and_size_do_not_matter(size):
    turn = Rotation.from_euler("xyz", [0.3, 1.1, -0.4]).as_matrix()
    moved = size * SEEN.points @ turn.T + 7.0 * size
    found = between(moved, np.full(3, 7.0 * size), Even(0.003 * size))
    expected = between(SEEN.points, ORIGIN, Even(0.003))
    assert (found != expected).sum() <= 2  # of equally near rays another may come first


def test_each_point_may_have_its_own_viewpoint():
    there = np.array([5.0, 0.0, 0.0])
    both = np.concatenate([SEEN.points, SEEN.points + there])
    places = np.repeat([ORIGIN, there], len(SEEN.points), axis=0)
    order = np.random.default_rng(0).permutation(len(both))
    found = np.zeros(len(both), bool)
    found[order] = between(both[order], places[order], Even(0.003))
    once = between(SEEN.points, ORIGIN, Even(0.003))
    np.testing.assert_array_equal(found[: len(once)], once)
    assert (found[len(once) :] != once).sum() <= 2
    moving = both + np.linspace(0.0, 1.0, len(both))[:, None]
    assert not between(both, moving, Even(0.003)).any()  # no two from one place


def floor(rng=None):
    """A floor from above, at up to 86 degrees, by rows of rays or at random."""
    turn, dive = np.radians(np.arange(-40.0, 40.0, 0.5)), np.radians(np.arange(-60.0, -4.0, 0.5))
    turn, dive = (x.ravel() for x in np.meshgrid(turn, dive))
    if rng is not None:
        turn, dive = rng.uniform(-0.7, 0.7, 8000), np.arcsin(-rng.uniform(0.07, 0.86, 8000))
    flat = np.stack([np.cos(dive) * np.sin(turn), np.cos(dive) * np.cos(turn)], axis=1)
    return np.column_stack([flat, np.sin(dive)]) * (1.5 / np.sin(-dive))[:, None]


def test_a_floor_does_not_hang_however_steeply_it_is_seen():
    assert not between(floor(), ORIGIN, Even(0.0)).any()
    assert between(floor(np.random.default_rng(0)), ORIGIN, Even(0.0)).mean() < 0.03


def test_leaves_are_left_alone():
    cloud = np.random.default_rng(0).uniform(-1.0, 1.0, (5000, 3))
    cloud[:, 2] += 5.0
    assert not between(cloud, ORIGIN, Even(0.0)).any()


@pytest.mark.parametrize("viewpoint", [[0.0, 0.0, 1e12], [0.0, 0.0, 2.2], [1e-9, 0.0, 1.2]])
def test_odd_viewpoints(viewpoint):
    assert between(SEEN.points, np.array(viewpoint), Even(0.003)).mean() <= 0.1


@pytest.mark.parametrize("n", [4, 9, 99])
def test_few_points_are_no_view(n):
    assert not between(SEEN.points[:n], ORIGIN, Even(0.0)).any()


def test_nothing_is_built_between_ball_and_wall():
    estimate = pipeline.reconstruct_surface(SEEN.points, viewpoint=ORIGIN, trim="auto", n_threads=2)
    normals = estimate.normals
    assert normals.outliers[HANGING].mean() > 0.85
    assert normals.outliers[~HANGING].mean() < 0.01
    hanging = between(SEEN.points, ORIGIN, Even(0.003))
    assert (normals.confidence[hanging & HANGING] == 0.0).mean() > 0.95
    places = mesh_properties.sample_surface(estimate.vertices, estimate.triangles, 5000)[0]
    error = SEEN._replace(points=places, on_ball=places[:, 2] < 1.6).errors()
    assert (error > 0.1).mean() < 0.05
    assert mesh_properties.component_labels(estimate.triangles)[0] == 2
