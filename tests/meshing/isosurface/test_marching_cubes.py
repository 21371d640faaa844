"""Closed manifolds from any signs, and the vertices that everybody else finds."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_checks import assert_valid_mesh

from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.meshing.isosurface.marching_cubes import (
    CORNERS,
    EDGES,
    NUDGES,
    marching_cubes,
    triangle_table,
)


def grid(values):
    """Nodes and all cubes of a dense array of values, axis 0 fastest."""
    shape = np.array(values.shape)
    steps = np.array([1, shape[0], shape[0] * shape[1]])
    index = np.stack(np.unravel_index(np.arange(values.size), shape, order="F"), axis=1)
    cubes = (index @ steps)[(index < shape - 1).all(axis=1)][:, None] + CORNERS @ steps
    return values.ravel(order="F"), index.astype(np.float64), cubes.astype(np.int32)


def triangulate(values):
    return marching_cubes(*grid(values))


def walled(rng, shape, bias=0.0):
    """Random values, positive on the wall."""
    values = np.ones(shape)
    values[1:-1, 1:-1, 1:-1] = rng.uniform(-1.0, 1.0, np.array(shape) - 2) + bias
    return values


@pytest.mark.parametrize("case", range(256))
def test_every_case_closes_among_positive_neighbors(case):
    values = np.ones((4, 4, 4))
    inside = CORNERS[[bool(case >> corner & 1) for corner in range(8)]] + 1
    values[tuple(inside.T)] = -1.0
    vertices, triangles = triangulate(values)
    if case == 0:
        assert len(triangles) == 0
        return
    assert_valid_mesh(vertices, triangles)


@pytest.mark.parametrize("case", range(1, 255))
def test_every_case_cuts_its_edges_and_no_others(case):
    cut = {e for e, (c, axis) in enumerate(EDGES) if (case >> c ^ case >> (c | 1 << axis)) & 1}
    table, members = triangle_table()
    used = set(table[case][table[case] >= 0].tolist())
    assert {vertex for vertex in used if vertex < 12} == cut
    for middle in (vertex for vertex in used if vertex >= 12):
        loop = members[case, middle - 12]
        assert set(loop[loop >= 0].tolist()) <= cut


def test_opposite_cases_cut_the_same_edges():
    table, _ = triangle_table()
    for case in range(256):
        one, other = (table[c][(table[c] >= 0) & (table[c] < 12)] for c in (case, 255 - case))
        assert set(one.tolist()) == set(other.tolist())


@pytest.mark.parametrize("bias", [-0.6, 0.0, 0.6])
@pytest.mark.parametrize("seed", range(4))
def test_random_fields_give_closed_manifolds(seed, bias):
    vertices, triangles = triangulate(walled(np.random.default_rng(seed), (14, 9, 11), bias))
    assert triangles.dtype == np.int32
    assert_valid_mesh(vertices, triangles)


@pytest.mark.parametrize("seed", range(3))
def test_values_of_zero_leave_no_triangle_without_area(seed):
    values = np.sign(walled(np.random.default_rng(seed), (10, 10, 10)).round())
    vertices, triangles = triangulate(values)
    assert_valid_mesh(vertices, triangles)
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 0.0


def test_the_worst_field_gives_a_closed_manifold():
    """A checkerboard has an ambiguous pair of corners on every face."""
    values = np.ones((10, 10, 10))
    i, j, k = np.indices((8, 8, 8))
    values[1:-1, 1:-1, 1:-1] = np.where((i + j + k) % 2, 1.0, -1.0)
    assert_valid_mesh(*triangulate(values), components=256)


def test_random_fields_inside_out_are_the_same_surface_turned():
    values = np.random.default_rng(1).uniform(-1.0, 1.0, (8, 8, 8))
    positive, negative = values.copy(), -values
    vertices, _ = triangulate(positive)
    turned, _ = triangulate(negative)
    on_edge, turned_on_edge = (v[(v % 1.0 != 0.0).sum(axis=1) == 1] for v in (vertices, turned))
    np.testing.assert_allclose(
        on_edge[np.lexsort(on_edge.T)], turned_on_edge[np.lexsort(turned_on_edge.T)], atol=1e-12
    )


@pytest.mark.parametrize("seed", range(3))
def test_vertices_are_those_of_scikit_image(seed):
    measure = pytest.importorskip("skimage.measure")
    values = walled(np.random.default_rng(seed), (12, 10, 11)).astype(np.float32)
    expected = measure.marching_cubes(values, 0.0, method="lorensen")[0]
    vertices, _ = triangulate(values.astype(np.float64))
    on_edge = vertices[(vertices % 1.0 != 0.0).sum(axis=1) == 1]
    assert len(on_edge) == len(np.unique(expected.round(6), axis=0))
    distance = np.linalg.norm(on_edge[:, None] - expected[None], axis=2)
    assert np.median(distance.min(axis=1)) < 1e-6
    assert distance.min(axis=1).max() < NUDGES[0] + 1e-5
    assert distance.min(axis=0).max() < NUDGES[0] + 1e-5


def sphere_values(n, radius):
    nodes = np.indices((n, n, n)) - 0.5 * (n - 1)
    return np.linalg.norm(nodes, axis=0) - radius


@pytest.mark.parametrize(("n", "radius", "error"), [(12, 4.0, 0.05), (40, 17.0, 0.003)])
def test_sphere(n, radius, error):
    vertices, triangles = triangulate(sphere_values(n, radius))
    assert_valid_mesh(vertices, triangles, components=1)
    assert mesh_properties.euler_characteristic(triangles) == 2
    volume = mesh_properties.signed_volume(vertices, triangles)
    assert volume == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=error)
    distance = np.linalg.norm(vertices - 0.5 * (n - 1), axis=1)
    assert np.abs(distance - radius).max() < 0.05


def test_torus():
    x, y, z = np.indices((40, 40, 20)) - np.array([19.5, 19.5, 9.5])[:, None, None, None]
    vertices, triangles = triangulate(np.hypot(np.hypot(x, y) - 12.0, z) - 5.0)
    assert_valid_mesh(vertices, triangles, components=1)
    assert mesh_properties.euler_characteristic(triangles) == 0


def test_vertices_interpolate_linearly():
    slope, offset = np.array([0.3, -0.5, 0.8]), 1.37
    nodes = np.indices((6, 6, 6)).reshape(3, -1).T
    vertices, triangles = triangulate((nodes @ slope - offset).reshape(6, 6, 6))
    assert len(triangles)
    error = np.abs(vertices @ slope - offset)
    assert np.median(error) < 1e-12
    assert error.max() <= NUDGES[0] * np.abs(slope).max()
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals @ slope > 0.0).all()  # outward is where values grow


def test_only_listed_cubes_are_triangulated():
    values, nodes, cubes = grid(sphere_values(12, 4.0))
    everything = marching_cubes(values, nodes, cubes)
    sign = (values[cubes] < 0).sum(axis=1)
    some = marching_cubes(values, nodes, cubes[(sign > 0) & (sign < 8)])
    np.testing.assert_array_equal(everything[0], some[0])
    np.testing.assert_array_equal(everything[1], some[1])
    half = marching_cubes(values, nodes, cubes[: len(cubes) // 2])
    assert 0 < len(half[1]) < len(some[1])


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_change_of_sign_no_surface(sign):
    vertices, triangles = triangulate(np.full((3, 3, 3), sign))
    assert vertices.shape == (0, 3)
    assert triangles.shape == (0, 3)
