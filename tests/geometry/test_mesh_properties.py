"""Mesh properties on meshes whose properties are known; Open3D and trimesh-free oracles."""

from __future__ import annotations

import numpy as np
import pytest

from o3d_sofnn.geometry import mesh_properties

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture
def o3d():
    return pytest.importorskip("open3d")


def arrays(mesh):
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles)


def test_a_tetrahedron_is_watertight():
    assert mesh_properties.is_closed(TETRAHEDRON)
    assert mesh_properties.is_edge_manifold(TETRAHEDRON)
    assert mesh_properties.is_vertex_manifold(TETRAHEDRON)
    assert mesh_properties.is_consistently_wound(TETRAHEDRON)
    assert mesh_properties.is_watertight(TETRAHEDRON)
    assert mesh_properties.euler_characteristic(TETRAHEDRON) == 2
    assert mesh_properties.signed_volume(CORNERS, TETRAHEDRON) == pytest.approx(1 / 6)
    assert mesh_properties.signed_volume(CORNERS, TETRAHEDRON[:, ::-1]) == pytest.approx(-1 / 6)


def test_the_volume_is_exact_far_from_the_origin():
    moved = CORNERS + np.array([5e5, 4.9e6, 100.0])
    assert mesh_properties.signed_volume(moved, TETRAHEDRON) == pytest.approx(1 / 6, rel=1e-8)


def test_a_missing_triangle_opens_the_mesh():
    opened = TETRAHEDRON[:-1]
    assert not mesh_properties.is_closed(opened)
    assert not mesh_properties.is_watertight(opened)
    assert mesh_properties.is_edge_manifold(opened)
    assert mesh_properties.is_vertex_manifold(opened)
    assert mesh_properties.boundary_edges(opened).tolist() == [[0, 2], [0, 3], [2, 3]]


def test_one_turned_triangle_is_found():
    turned = TETRAHEDRON.copy()
    turned[0] = turned[0, ::-1]
    assert mesh_properties.is_closed(turned)
    assert not mesh_properties.is_consistently_wound(turned)
    assert not mesh_properties.is_watertight(turned)


def test_three_triangles_at_an_edge_are_not_manifold():
    fan = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])
    assert not mesh_properties.is_edge_manifold(fan)


def test_two_tetrahedra_at_a_common_vertex_are_not_vertex_manifold():
    pair = np.vstack([TETRAHEDRON, np.array([0, 4, 5, 6])[TETRAHEDRON]])
    assert mesh_properties.is_watertight(pair)
    assert not mesh_properties.is_vertex_manifold(pair)
    assert mesh_properties.component_labels(pair)[0] == 1


def test_a_triangle_that_repeats_a_vertex_is_not_manifold():
    assert mesh_properties.has_repeated_indices(np.array([[0, 1, 1]]))
    assert not mesh_properties.is_edge_manifold(np.array([[0, 1, 1]]))


def test_the_empty_mesh_is_not_closed():
    empty = np.zeros((0, 3), dtype=np.int64)
    assert not mesh_properties.is_closed(empty)
    assert not mesh_properties.is_watertight(empty)
    assert mesh_properties.is_vertex_manifold(empty)
    assert mesh_properties.component_labels(empty)[0] == 0
    assert mesh_properties.euler_characteristic(empty) == 0


def test_components_are_numbered_as_they_appear():
    pair = np.vstack([TETRAHEDRON + 4, TETRAHEDRON])
    count, labels = mesh_properties.component_labels(pair)
    assert count == 2
    assert labels.tolist() == [0] * 4 + [1] * 4


@pytest.mark.parametrize("name", ["sphere", "torus", "box", "cylinder"])
def test_open3d_agrees(o3d, name):
    mesh = getattr(o3d.geometry.TriangleMesh, f"create_{name}")()
    vertices, triangles = arrays(mesh)
    assert mesh_properties.is_watertight(triangles) == mesh.is_watertight()
    assert mesh_properties.is_edge_manifold(triangles) == mesh.is_edge_manifold(False)
    assert mesh_properties.is_vertex_manifold(triangles) == mesh.is_vertex_manifold()
    assert mesh_properties.euler_characteristic(triangles) == mesh.euler_poincare_characteristic()
    assert mesh_properties.signed_volume(vertices, triangles) == pytest.approx(mesh.get_volume())
    assert mesh_properties.triangle_areas(vertices, triangles).sum() == pytest.approx(
        mesh.get_surface_area()
    )


def test_random_triangle_soups_agree_with_open3d(o3d):
    rng = np.random.default_rng(0)
    verdicts = set()
    for _ in range(300):
        count = rng.integers(2, 7)
        triangles = np.stack([rng.choice(6, 3, replace=False) for _ in range(count)])
        triangles = np.unique(np.sort(triangles, axis=1), axis=0)
        mesh = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(rng.normal(size=(6, 3))),
            o3d.utility.Vector3iVector(triangles),
        )
        verdict = mesh_properties.is_vertex_manifold(triangles)
        verdicts.add(verdict)
        assert mesh_properties.is_edge_manifold(triangles) == mesh.is_edge_manifold(True)
        assert verdict == mesh.is_vertex_manifold(), triangles
    assert verdicts == {True, False}


def test_samples_lie_on_the_surface_and_are_even():
    points, normals = mesh_properties.sample_surface(CORNERS, TETRAHEDRON, 20000, seed=3)
    on_slope = np.isclose(points.sum(axis=1), 1.0)
    on_sides = np.isclose(points, 0.0).any(axis=1)
    assert (on_slope | on_sides).all()
    share = np.sqrt(3) / (np.sqrt(3) + 3)
    assert on_slope.mean() == pytest.approx(share, abs=0.01)
    assert np.allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert np.allclose(points[on_slope].mean(axis=0), 1 / 3, atol=0.01)
    again, _ = mesh_properties.sample_surface(CORNERS, TETRAHEDRON, 20000, seed=3)
    assert np.array_equal(points, again)


def test_angles_and_flips():
    up = np.array([[0.0, 0.0, 1.0]] * 3)
    tilt = np.radians(1e-6)
    other = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [np.sin(tilt), 0.0, np.cos(tilt)]])
    assert np.allclose(mesh_properties.normal_angles(other, up), [0.0, 90.0, 1e-6], rtol=1e-6)
    assert mesh_properties.flipped_fraction(other, up) == pytest.approx(2 / 3)
