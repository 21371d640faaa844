"""Kernels over cubes and triangles against their twins."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_data import mesh
from random_grids import random_grid

from o3d_sofnn import _kernels, reference
from o3d_sofnn.meshing.isosurface.grid import AdaptiveGrid
from o3d_sofnn.meshing.isosurface.marching_cubes import EDGE_ENDS, NUDGES, both_tables


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("bias", [-0.6, 0.0, 0.6])
def test_marching_cubes(seed, bias):
    rng, grid, walk, cubes = random_grid(seed)
    leaves, index = walk.corners(cubes)
    place = grid.positions(leaves)
    outside = ((place < grid.low) | (place > grid.high)).any(axis=1)
    values = np.where(outside, 1.0, rng.uniform(-1.0, 1.0, len(leaves)) + bias)
    args = (values, place, index.astype(np.int32), *both_tables(), EDGE_ENDS, NUDGES)
    vertices, triangles, uneven, inner = _kernels.marching_cubes(*args)
    expected = reference.marching_cubes(*args)
    np.testing.assert_array_equal(triangles, expected[1])
    np.testing.assert_allclose(vertices, expected[0], rtol=0.0, atol=1e-14)
    assert 0 < len(uneven) < len(vertices)
    np.testing.assert_array_equal(np.sort(uneven), expected[2])
    np.testing.assert_allclose(np.asarray(inner)[np.argsort(uneven)], expected[3], atol=1e-14)


@pytest.mark.parametrize("seed", range(6))
def test_walk(seed):
    rng = np.random.default_rng(seed)
    points = np.concatenate([rng.uniform(0.0, 1.0, (9, 3)), [[0.0] * 3, [1.0] * 3]])
    levels = rng.integers(0, 4, len(points))
    grid = AdaptiveGrid(points, 1 / 32, levels)
    slopes = rng.normal(0.0, 8.0, (4, 3))
    walks = grid.walk(), reference.DualWalk(points, grid.origin, grid.size, levels, grid.top)
    found = []
    for walk in walks:
        signs = np.zeros(0, bool)
        while len(wanted := np.asarray(walk.advance(signs))):
            x = grid.positions(wanted)
            outside = ((x < grid.low) | (x > grid.high)).any(axis=1)
            signs = (np.sin(x @ slopes.T).sum(axis=1) < 0.3) & ~outside
        leaves = np.asarray(walk.leaves())
        cubes = leaves[np.asarray(walk.take_crossed())]
        found.append((np.sort(leaves), cubes[np.lexsort(cubes.T)]))
    assert len(found[0][1]) > 100
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("seed", range(3))
def test_surroundings(seed):
    vertices, triangles, _ = mesh(seed)
    found = _kernels.surroundings(vertices, triangles)
    for array, expected in zip(found, reference.surroundings(vertices, triangles), strict=True):
        np.testing.assert_allclose(array, expected, rtol=0.0, atol=1e-13)
    np.testing.assert_array_equal(_kernels.vertex_normals(vertices, triangles), found[0])


def test_a_vertex_without_triangles_has_a_normal():
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [5.0, 5.0, 5.0]])
    triangles = np.array([[0, 1, 2]], np.int32)
    normals = np.asarray(_kernels.vertex_normals(vertices, triangles))
    np.testing.assert_array_equal(normals, [[0.0, 0.0, -1.0]] * 3 + [[0.0, 0.0, 1.0]])
    np.testing.assert_array_equal(normals, reference.vertex_normals(vertices, triangles))


@pytest.mark.parametrize("least", [0.9, 0.99])
def test_bent_vertices(least):
    _, triangles, rough = mesh(0)
    normals = reference.vertex_normals(rough, triangles)
    found = np.asarray(_kernels.bent_vertices(rough, triangles, normals, least))
    np.testing.assert_array_equal(found, reference.bent_vertices(rough, triangles, normals, least))
    assert 0 < found.sum() < len(found)


@pytest.mark.parametrize("seed", range(3))
def test_undo_turns(seed):
    vertices, triangles, moved = mesh(seed)
    found = np.asarray(_kernels.undo_turns(vertices, moved, triangles, 0.5))
    np.testing.assert_array_equal(found, reference.undo_turns(vertices, moved, triangles, 0.5))
    stays = (found == vertices).all(axis=1)
    assert 0 < stays.sum() < len(stays)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 1.0])
def test_label_pieces(share):
    vertices, triangles, _ = mesh(0)
    some = triangles[np.random.default_rng(0).random(len(triangles)) < share]
    found = np.asarray(_kernels.label_pieces(some, len(vertices)))
    np.testing.assert_array_equal(found, reference.label_pieces(some, len(vertices)))
    assert (found.max() == 0) == (share == 1.0)


def test_divide_cells():
    rng = np.random.default_rng(0)
    normals = rng.normal([0.0, 0.0, 3.0], size=(2000, 3))
    normals *= rng.choice([-1.0, 1.0], (2000, 1)) / np.linalg.norm(normals, axis=1, keepdims=True)
    first = np.unique(np.concatenate([[0, 2000], rng.integers(1, 2000, 80)]))
    order, size = reference.divide_cells(normals, first)
    for threads in (1, 3):
        found = _kernels.divide_cells(normals, first, threads)
        np.testing.assert_array_equal(found[0], order)
        np.testing.assert_array_equal(found[1], size)
