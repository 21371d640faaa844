"""Boxes around points."""

from __future__ import annotations

import numpy as np
import pytest

from o3d_sofnn.geometry.vectors import BLOCK, affine_rank, bounds, longest_side


@pytest.mark.parametrize("n", [1, 2, BLOCK - 1, BLOCK, BLOCK + 1, 5 * BLOCK + 7])
def test_bounds(n):
    x = np.random.default_rng(n).normal(size=(n, 3))
    low, high = bounds(x)
    np.testing.assert_array_equal(low, x.min(axis=0))
    np.testing.assert_array_equal(high, x.max(axis=0))
    assert longest_side(x) == np.ptp(x, axis=0).max()


@pytest.mark.parametrize("rank", [0, 1, 2, 3])
def test_rank_of_many_points(rank):
    x = np.random.default_rng(0).normal(size=(50_000, 3)) * (np.arange(3) < rank) + 1.0
    assert affine_rank(x) == rank


def test_one_point_outside_of_a_plane():
    x = np.random.default_rng(0).normal(size=(50_000, 3)) * [1.0, 1.0, 0.0]
    x[1, 2] = 1.0
    assert affine_rank(x) == 3
