"""Morton order, distinct points and leaves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapes import sphere, two_spheres

from o3d_sofnn import reference
from o3d_sofnn._kernels import sort_morton
from o3d_sofnn.sampling.cells import LEVELS, build_octree, sort_unique


def slow_key(x, y, z):
    """Interleave the bits of three integers one by one."""
    return sum(
        (x >> bit & 1) << 3 * bit | (y >> bit & 1) << 3 * bit + 1 | (z >> bit & 1) << 3 * bit + 2
        for bit in range(LEVELS)
    )


def assert_covers(cells, points, capacity):
    """Check that the leaves are a partition of the points, of the promised size."""
    count = np.diff(cells.offsets)
    assert cells.offsets[0] == 0
    assert cells.offsets[-1] == len(points)
    assert (count > 0).all()
    np.testing.assert_array_equal(np.sort(cells.order), np.arange(len(points)))
    np.testing.assert_array_equal(cells.points, points[cells.order])
    assert len(cells.size) == len(count)
    extent = np.ptp(points, axis=0).max()
    finest = cells.size <= extent / 2**LEVELS
    assert ((count <= capacity) | finest).all()
    high = np.maximum.reduceat(cells.points, cells.offsets[:-1])
    low = np.minimum.reduceat(cells.points, cells.offsets[:-1])
    # Keys divide the extent in 2^21 - 1 parts, so that the highest point still has a cell.
    assert ((high - low).max(axis=1) <= cells.size * (1 + 2.0 ** (1 - LEVELS))).all()


def keys_of(points):
    """Key of each point, from the sorted ones."""
    keys, order = map(np.asarray, sort_morton(points, 2))
    assert (keys[1:] >= keys[:-1]).all()
    return keys[np.argsort(order)]


def test_keys_interleave_the_bits_of_the_coordinates():
    top = 2**LEVELS - 1
    rng = np.random.default_rng(0)
    whole = np.vstack([rng.integers(0, top + 1, (200, 3)), [[0, 0, 0], [top, top, top]]])
    keys = keys_of(whole.astype(np.float64))
    assert keys.tolist() == [slow_key(*map(int, row)) for row in whole]
    assert int(keys.max()) == 2 ** (3 * LEVELS) - 1


def test_keys_do_not_depend_on_place_and_size():
    whole = np.random.default_rng(0).integers(0, 2**LEVELS, (300, 3)).astype(np.float64)
    keys = keys_of(whole)
    np.testing.assert_array_equal(keys_of(whole * 2.0**-30), keys)
    np.testing.assert_array_equal(keys_of(whole - 2.0**30), keys)


def test_equal_points_share_one_key():
    assert (keys_of(np.full((5, 3), 7.0)) == 0).all()
    assert len(keys_of(np.empty((0, 3)))) == 0


@pytest.mark.parametrize("step", [1e-3, 1.0])
def test_points_are_sorted_as_by_the_twin(step):
    points = np.rint(np.random.default_rng(0).normal(size=(5000, 3)) / step) * step
    for found, expected in zip(sort_morton(points, 2), reference.sort_morton(points), strict=True):
        np.testing.assert_array_equal(found, expected)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n=st.integers(1, 300),
    side=st.integers(1, 12),
    tiny=st.sampled_from([0.0, 1e-9]),
)
def test_distinct_points_and_back(seed, n, side, tiny):
    rng = np.random.default_rng(seed)
    points = rng.integers(0, side, (n, 3)) + tiny * rng.integers(0, 2, (n, 3))
    order, inverse = sort_unique(points)
    assert len(order) == len(np.unique(points, axis=0))
    np.testing.assert_array_equal(points[order][inverse], points)
    first = {tuple(row): n - 1 - i for i, row in enumerate(points[::-1])}
    np.testing.assert_array_equal(order, [first[tuple(row)] for row in points[order]])
    keys = keys_of(points)[order]
    assert (keys[1:] >= keys[:-1]).all()


def test_order_of_distinct_points_does_not_depend_on_their_order():
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.normal(size=(200, 3)), rng.normal(size=(200, 3)) * 1e-9])
    points = np.concatenate([points, points[:50]])
    shuffled = points[rng.permutation(len(points))]
    np.testing.assert_array_equal(
        points[sort_unique(points)[0]], shuffled[sort_unique(shuffled)[0]]
    )


@pytest.mark.parametrize("capacity", [1, 3, 32, 10_000])
def test_leaves(capacity):
    points = sphere(2000).points
    cells = build_octree(points, capacity)
    assert_covers(cells, points, capacity)
    if capacity >= len(points):
        assert len(cells.size) == 1
    else:
        assert np.diff(cells.offsets).mean() > capacity / 8


def test_leaves_hold_the_points_of_one_cube():
    points = np.random.default_rng(0).integers(0, 2**LEVELS, (500, 3)).astype(np.float64)
    cells = build_octree(points, 8)
    low = points.min(axis=0)
    extent = np.ptp(points, axis=0).max()
    whole = ((cells.points - low) * ((2**LEVELS - 1) / extent)).astype(np.int64)
    level = np.rint(np.log2(extent / cells.size)).astype(np.int64)
    shift = np.repeat(LEVELS - level, np.diff(cells.offsets))
    cubes = np.column_stack([np.repeat(level, np.diff(cells.offsets)), whole >> shift[:, None]])
    leaf = np.repeat(np.arange(len(level)), np.diff(cells.offsets))
    pairs = np.unique(np.column_stack([leaf, cubes]), axis=0)
    assert len(pairs) == len(level) == len(np.unique(cubes, axis=0))


@pytest.mark.parametrize("n", [1, 2])
def test_leaves_of_few_points(n):
    points = np.arange(3.0 * n).reshape(n, 3)
    assert_covers(build_octree(points, 1), points, 1)


def test_points_closer_than_the_finest_cell_stay_together():
    rng = np.random.default_rng(0)
    points = np.concatenate([1e-9 * rng.random((100, 3)), [[1.0, 1.0, 1.0]]])
    cells = build_octree(points, 4)
    assert_covers(cells, points, 4)
    assert np.diff(cells.offsets).max() == 100
    order, inverse = sort_unique(points)
    assert len(order) == 101
    np.testing.assert_array_equal(points[order][inverse], points)


@pytest.mark.parametrize("distance", [1e3, 1e5])
def test_two_far_objects_are_divided_like_one(distance):
    points = two_spheres(2000, distance).points
    cells = build_octree(points, 32)
    assert_covers(cells, points, 32)
    sides = points[:, 0] > distance / 2.0
    for leaf, last in zip(cells.offsets[:-1], cells.offsets[1:], strict=True):
        assert len(np.unique(sides[cells.order[leaf:last]])) == 1


def test_a_flat_and_a_straight_cloud_are_divided():
    rng = np.random.default_rng(0)
    for flat in (rng.random((500, 3)) * [1, 1, 0], rng.random((500, 3)) * [0, 0, 1]):
        cells = build_octree(flat, 16)
        assert_covers(cells, flat, 16)
        assert len(cells.size) > 500 / 16
