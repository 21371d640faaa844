"""Rounded coordinates are found, and nothing else is taken for them."""

from __future__ import annotations

import numpy as np
import pytest
from depth_scenes import RADIUS, frame
from shapes import CLOSED, box, sphere, torus

from o3d_sofnn import pipeline
from o3d_sofnn.sampling.normalization import unit_cube
from o3d_sofnn.sampling.quantization import find_steps, spread_rounded

RNG = np.random.default_rng(0)
TORUS = torus(6000).points
SPACING = np.sqrt(4.0 * np.pi**2 * 0.4 / 6000)


def steps_of(points):
    """Widths in the unit of the points, and what was found."""
    cloud = unit_cube(np.asarray(points, float))
    steps = find_steps(cloud.points, -cloud.middle / cloud.extent)
    return cloud.extent * steps.width, steps


def rounded(points, step):
    step = np.broadcast_to(np.asarray(step, float), 3)
    safe = np.where(step > 0.0, step, 1.0)
    return np.where(step > 0.0, np.round(points / safe) * safe, points)


@pytest.mark.parametrize("offset", [0.0, 5.123e5])
@pytest.mark.parametrize("step", [0.25, 0.5, 1.0, 2.0])
def test_the_step_of_all_axes_is_found(step, offset):
    width, steps = steps_of(rounded(TORUS, step * SPACING) + offset)
    assert (width > 0.0).mean() > 0.9
    np.testing.assert_allclose(width[width > 0.0], step * SPACING, rtol=1e-4)
    assert not steps.coarse.any()  # distinct points are a step apart


@pytest.mark.parametrize("axis", [0, 2])
@pytest.mark.parametrize("step", [1.0, 2.0, 4.0])
def test_the_step_of_one_axis_is_found(step, axis):
    wanted = np.zeros(3)
    wanted[axis] = step * SPACING
    width, steps = steps_of(rounded(TORUS, wanted))
    others = np.delete(width, axis, axis=1)
    assert (width[:, axis] > 0.0).mean() > 0.8
    assert not others.any()
    np.testing.assert_allclose(width[width > 0.0], step * SPACING, rtol=1e-4)
    assert steps.coarse[:, axis].mean() > 0.8 if step >= 2.0 else not steps.coarse.any()


def test_large_coordinates_in_single_precision_were_rounded():
    far = np.array([5e5, 4.9e6, 0.0])
    width, _ = steps_of((10.0 * TORUS + far).astype(np.float32))
    # 2^-5, the step of the other, is a twelfth of the spacing.
    np.testing.assert_allclose(np.median(width, axis=0), [0.0, 0.5, 0.0])


def lattice(n, size=(1.0, 1.0, 1.0)):
    """Faces of a box sampled on a grid that holds its edges."""
    i = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return i[((i == 0) | (i == n - 1)).any(axis=1)] * np.asarray(size) / (n - 1)


def sheet(noise=0.0, turn=0.0):
    """A regular height field."""
    x, y = (g.ravel() for g in np.meshgrid(np.linspace(0.0, 1.0, 80), np.linspace(0.0, 1.0, 80)))
    z = 0.2 * np.sin(6.0 * x) * np.cos(4.0 * y) + noise * RNG.normal(size=len(x))
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([c * x - s * y, s * x + c * y, z], axis=1)


def slices(step, noise=0.0):
    """Outlines of a bulged ball in parallel planes."""
    z = np.round(RNG.uniform(-0.98, 0.98, 8000) / step) * step
    turn = RNG.uniform(0.0, 2.0 * np.pi, 8000)
    radius = np.sqrt(np.maximum(1.0 - z**2, 0.01)) * (1.0 + 0.2 * np.cos(3.0 * turn))
    plane = radius[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.column_stack([plane + noise * RNG.normal(size=plane.shape), z])


def rings():
    """A cone sampled ring by ring."""
    turn, z = (
        g.ravel() for g in np.meshgrid(np.linspace(0.0, 6.28, 120), np.linspace(0.0, 2.0, 60))
    )
    return np.stack([(1.0 - 0.4 * z) * np.cos(turn), (1.0 - 0.4 * z) * np.sin(turn), z], axis=1)


def filled():
    """A ball full of voxels."""
    i = np.stack(np.meshgrid(*[np.arange(-12, 13)] * 3), axis=-1).reshape(-1, 3)
    return i[np.linalg.norm(i, axis=1) <= 12.0]


NOT_ROUNDED = {
    **{name: shape.points for name, shape in CLOSED.items()},
    "single precision": sphere(3000).points.astype(np.float32),
    "thin box in single precision": box(3000, (1.0, 1.0, 0.05)).points.astype(np.float32),
    "digits far below the spacing": np.round(TORUS, 3),
    "cube on a grid": lattice(21),
    "fine cube on a grid": lattice(41),
    "cube on a coarse grid": lattice(9),
    "brick on a grid": lattice(21, (1.0, 2.0, 0.5)),
    "height field": sheet(),
    "noisy height field": sheet(0.004),
    "turned height field": sheet(turn=0.4),
    "roof": np.column_stack([sheet()[:, :2], sheet()[:, 0]]),
    "slices": slices(0.05),
    "slices far apart": slices(0.15),
    "slices with noise": slices(0.1, 0.01),
    "rings": rings(),
    "voxels": filled(),
}


@pytest.mark.parametrize("name", NOT_ROUNDED)
def test_samples_are_not_taken_for_rounded(name):
    cloud = unit_cube(np.asarray(NOT_ROUNDED[name], float))
    found, steps = spread_rounded(cloud)
    assert steps.tree is None
    assert found is cloud


def test_rounded_heights_on_a_grid_are_found():
    points = rounded(sheet(), (0.0, 0.0, 0.01))
    width, _ = steps_of(points)
    assert np.median(width, axis=0).tolist() == pytest.approx([0.0, 0.0, 0.01])


def test_points_stay_in_their_cells_and_fill_them():
    cloud = unit_cube(rounded(TORUS, (0.0, 0.0, 4.0 * SPACING)))
    found, steps = spread_rounded(cloud)
    moved = (found.points - cloud.points) * cloud.extent / (4.0 * SPACING)
    assert np.abs(moved[:, :2]).max() == 0.0
    assert np.abs(moved[:, 2]).max() <= 0.5
    assert np.histogram(moved[moved[:, 2] != 0.0, 2], 10, (-0.5, 0.5))[0].std() < 20.0
    np.testing.assert_array_equal(found.points, steps.spread(cloud.points))
    assert "rounded to steps longer than the spacing (z:" in found.warnings[0]


@pytest.mark.parametrize("step", [0.5, 1.0])
def test_noise_of_flat_parts_is_that_of_rounding(step):
    cube = box(8000, (1.0, 0.8, 0.6)).points
    tilt = np.array([[1.0, 0.0, 0.1], [0.0, 1.0, 0.06], [-0.1, -0.06, 1.0]])
    spacing = np.sqrt(2.0 * (0.8 + 0.6 + 0.48) / 8000)
    estimate = pipeline.estimate_normals(rounded(cube @ tilt, step * spacing), n_threads=2)
    assert estimate.noise_level == pytest.approx(step * spacing / np.sqrt(12.0), rel=0.15)


@pytest.mark.parametrize("step", [0.5, 1.0])
def test_noise_does_not_count_the_spreading(step):
    deep = rounded(TORUS, (0.0, 0.0, 4.0 * step * SPACING))
    estimate = pipeline.estimate_normals(deep, n_threads=2)
    normals = torus(6000).normals
    truth = np.sqrt(np.mean(normals[:, 2] ** 2)) * 4.0 * step * SPACING / np.sqrt(12.0)
    assert np.sqrt(np.mean(estimate.noise**2)) == pytest.approx(truth, rel=0.4)


def test_steps_of_disparity_grow_with_the_square_of_the_depth():
    seen = frame().quantised(0.002)
    width, _ = steps_of(seen.points)
    assert not width[:, :2].any()
    estimate = pipeline.estimate_normals(seen.points, n_threads=2)
    wall = ~seen.on_ball
    assert np.median(estimate.noise[wall]) == pytest.approx(0.002 * 2.2**2 / np.sqrt(12), rel=0.1)
    near = seen.on_ball & (np.linalg.norm(seen.points[:, :2], axis=1) < 0.5 * RADIUS)
    assert np.median(estimate.noise[near]) == pytest.approx(0.002 * 1.22**2 / np.sqrt(12), rel=0.25)


def test_the_rest_of_a_cloud_does_not_hide_a_rounded_part():
    both = np.concatenate([rounded(TORUS, 0.5 * SPACING), TORUS + np.array([4.0, 0.0, 0.0])])
    cloud = unit_cube(both)
    steps = find_steps(cloud.points, -cloud.middle / cloud.extent)
    places = both[cloud.first][np.linspace(0, len(cloud.points) - 1, len(steps.width)).astype(int)]
    here = places[:, 0] < 2.0
    assert (steps.width[here] > 0.0).mean() > 0.9
    assert not steps.width[~here].any()
