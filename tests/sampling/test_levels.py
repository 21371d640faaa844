"""Levels of coordinates, and complete grids."""

from __future__ import annotations

import numpy as np
import pytest

from o3d_sofnn.sampling.levels import find_levels, sampling_pattern

RNG = np.random.default_rng(0)
X = RNG.uniform(-1.0, 1.0, (5, 300))


@pytest.mark.parametrize("offset", [0.0, 512345.67, -4.9e6])
@pytest.mark.parametrize("step", [0.04, 0.1, 0.5])
def test_the_step_is_found_at_any_offset(step, offset):
    found, count = find_levels(np.round(X / step) * step + offset)
    np.testing.assert_allclose(found, step, rtol=1e-6)
    levels = np.round(X.max(axis=1) / step) - np.round(X.min(axis=1) / step) + 1
    assert ((count > 0.9 * levels) & (count <= levels)).all()


def test_single_precision_does_not_hide_steps():
    values = (np.round(X / 0.1) * 0.1 + 250.0).astype(np.float32).astype(np.float64)
    blurred = values + RNG.uniform(-1e-5, 1e-5, values.shape)
    np.testing.assert_allclose(find_levels(blurred)[0], 0.1, rtol=1e-3)


def test_levels_that_are_missing_do_not_matter():
    level = np.round(X / 0.05)
    some = np.where(level % 7 == 0, level + 1, level)
    np.testing.assert_allclose(find_levels(0.05 * some)[0], 0.05)


@pytest.mark.parametrize(
    "values",
    [
        X,
        X.astype(np.float32).astype(np.float64),
        np.where(X < 0.0, 0.0, X),
        np.zeros((2, 300)),
        np.cumsum(RNG.exponential(1.0, (4, 20)), axis=1)[:, RNG.integers(0, 20, 300)],
    ],
    ids=["random", "single precision", "half in a plane", "one plane", "irregular"],
)
def test_other_coordinates_have_no_step(values):
    assert (find_levels(values)[0] == 0.0).all()


def grid(n=12):
    i, j = (x.ravel().astype(float) for x in np.meshgrid(np.arange(n), np.arange(n)))
    order = np.argsort(np.hypot(i - 5.0, j - 5.0))[:50]
    return i[order], j[order]


def test_a_complete_grid_is_a_pattern():
    i, j = grid()
    assert sampling_pattern(i[None], j[None]).tolist() == [True]
    assert sampling_pattern(i[None] - 7.0, j[None] + 1e5).tolist() == [True]


def test_rounded_points_are_no_pattern():
    x, y = RNG.normal(0.0, 2.0, (2, 6, 50))
    order = np.argsort(np.hypot(x, y), axis=1)
    x, y = np.take_along_axis(x, order, 1), np.take_along_axis(y, order, 1)
    assert not sampling_pattern(np.round(x), np.round(y)).any()
    sparse = np.round(10.0 * x), np.round(10.0 * y)
    assert not sampling_pattern(*sparse).any()


def test_columns_of_several_points_are_no_pattern():
    i, j = grid()
    assert not sampling_pattern(np.repeat(i, 2)[None, :50], np.repeat(j, 2)[None, :50]).any()
