"""The octree of the extraction: whatever its levels and signs, the surface is a closed manifold."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_checks import assert_no_intersections, assert_valid_mesh
from random_grids import random_grid

from o3d_sofnn import _kernels
from o3d_sofnn.meshing.isosurface.extraction import extract
from o3d_sofnn.meshing.isosurface.grid import AdaptiveGrid, unpack
from o3d_sofnn.meshing.isosurface.marching_cubes import (
    EDGE_ENDS,
    NUDGES,
    both_tables,
    marching_cubes,
)
from o3d_sofnn.reference.meshing.grid import contains, halve, pack


@pytest.mark.parametrize("seed", range(6))
def test_random_signs_on_random_levels_give_closed_manifolds(seed):
    rng, grid, walk, cubes = random_grid(seed)
    leaves, index = walk.corners(cubes)
    place = grid.positions(leaves)
    outside = ((place < grid.low) | (place > grid.high)).any(axis=1)
    assert len(np.unique(grid.edges(leaves))) > 1, "all leaves have one size"
    for bias in (-0.6, 0.0, 0.6):
        values = np.where(outside, 1.0, rng.uniform(-1.0, 1.0, len(leaves)) + bias)
        assert_valid_mesh(*marching_cubes(values, place, index.astype(np.int32)))


@pytest.mark.parametrize("seed", [1, 2])
def test_values_far_apart_on_random_levels_make_no_triangle_cut_another_one(seed):
    """Vertices lie as near to the nodes as they may: the worst for cubes that are none."""
    rng, grid, walk, cubes = random_grid(seed)
    leaves, index = walk.corners(cubes)
    place = grid.positions(leaves)
    outside = ((place < grid.low) | (place > grid.high)).any(axis=1)
    found = 0
    for _ in range(3):
        size = 10.0 ** rng.uniform(-6.0, 6.0, len(leaves))
        values = np.where(outside, 1.0, rng.choice([-1.0, 1.0], len(leaves)) * size)
        args = values, place, index.astype(np.int32)
        vertices, triangles = _kernels.marching_cubes(*args, *both_tables(), EDGE_ENDS, NUDGES)[:2]
        everything = np.ones(len(triangles), bool)
        found += len(_kernels.intersecting_pairs(vertices, triangles, everything, 1))
        assert_no_intersections(*marching_cubes(*args))
    assert found > 0, "values that make none need no second place"


@pytest.mark.parametrize("seed", range(3))
def test_leaves_that_touch_differ_by_one_level_at_most(seed):
    _, grid, walk, cubes = random_grid(seed)
    leaves, index = walk.corners(cubes)
    edges = grid.edges(leaves)[index]
    assert (edges.max(axis=1) <= 2 * edges.min(axis=1)).all()


def test_a_cube_is_its_neighbors_neighbor():
    _, _, walk, cubes = random_grid(0)
    leaves, index = walk.corners(cubes)
    for axis in range(3):
        crossed = np.zeros((len(cubes), 3, 2), bool)
        crossed[:, axis, 1] = True
        beyond = walk.across(cubes, leaves, index, crossed)
        crossed = np.zeros((len(beyond), 3, 2), bool)
        crossed[:, axis, 0] = True
        back = walk.across(beyond, *walk.corners(beyond), crossed)
        assert contains(cubes, back).all()


def test_keys_and_coordinates():
    index = np.random.default_rng(0).integers(0, 2**21, (100, 3))
    np.testing.assert_array_equal(unpack(pack(index)), index)
    np.testing.assert_array_equal(halve(pack(index), 3), pack(index >> 3))


def test_too_many_cubes_are_refused():
    points = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    with pytest.raises(ValueError, match="voxel_size"):
        AdaptiveGrid(points, 1e-7, np.zeros(2, np.int64))


def ball(x):
    return np.linalg.norm(x, axis=1) - 1.0, np.ones(len(x))


def test_a_sphere_with_two_resolutions():
    points = np.random.default_rng(1).normal(size=(4000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    levels = np.where(points[:, 0] > 0.0, 0, 2)
    vertices, triangles = extract(ball, points, 0.04, levels)
    assert_valid_mesh(vertices, triangles, components=1)
    assert abs(ball(vertices)[0]).max() < 0.02
    right = (vertices[triangles].mean(axis=1)[:, 0] > 0.0).mean()
    assert right > 0.8, "the fine side has most of the triangles"


def test_far_from_the_seeds_triangles_are_few():
    points = np.random.default_rng(1).normal(size=(4000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    cap = points[points[:, 2] > 0.9]
    near = extract(ball, points, 0.02)
    far = extract(ball, np.concatenate([cap, [[-1.0] * 3, [1.0] * 3]]), 0.02)
    assert_valid_mesh(*far, components=1)
    assert len(far[1]) < 0.4 * len(near[1])
