"""Fewer triangles, the same topology, the same surface."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_checks import assert_valid_mesh
from shapes import plane_patch, torus

import o3d_sofnn
from o3d_sofnn import adapters
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.meshing.mesh import decimate
from o3d_sofnn.pipeline import reconstruct_surface


@pytest.fixture(scope="module")
def ring():
    return reconstruct_surface(torus(4000).points)


@pytest.mark.parametrize("share", [0.5, 0.1])
def test_a_ring_stays_a_ring_and_where_it_was(ring, share):
    target = int(share * len(ring.triangles))
    vertices, triangles, source = decimate(ring.vertices, ring.triangles, target)
    assert target - 1 <= len(triangles) <= target
    assert_valid_mesh(vertices, triangles, components=1)
    assert mesh_properties.euler_characteristic(triangles) == 0
    assert source.shape == (len(vertices),)
    from_axis = np.hypot(*vertices[:, :2].T) - 1.0
    assert abs(np.hypot(from_axis, vertices[:, 2]) - 0.4).max() < 0.02


def test_as_few_as_the_topology_needs(ring):
    vertices, triangles, _ = decimate(ring.vertices, ring.triangles, 1)
    assert_valid_mesh(vertices, triangles, components=1)
    assert mesh_properties.euler_characteristic(triangles) == 0


def test_enough_is_left_alone(ring):
    vertices, triangles, source = decimate(ring.vertices, ring.triangles, 10**9)
    assert vertices is ring.vertices
    assert triangles is ring.triangles
    np.testing.assert_array_equal(source, np.arange(len(vertices)))


def test_open_sheets_too():
    points = plane_patch(2000).points
    surface = reconstruct_surface(points, trim="auto", target_triangles=500)
    assert 499 <= len(surface.triangles) <= 500
    assert mesh_properties.is_vertex_manifold(surface.triangles)
    assert mesh_properties.euler_characteristic(surface.triangles) == 1
    assert len(surface.confidence) == len(surface.vertex_normals) == len(surface.vertices)


def test_the_operators_take_a_target(make_cloud, family):
    shape = torus(3000)
    cloud = make_cloud(shape.points, family, colors=np.full((3000, 3), 0.5))
    mesh = o3d_sofnn.reconstruct_surface(cloud, target_triangles=2000)
    assert_valid_mesh(mesh, components=1)
    arrays, triangles = adapters.read_mesh(mesh)
    assert 1999 <= len(triangles) <= 2000
    np.testing.assert_allclose(arrays.attributes["colors"], 0.5, atol=1e-6)
    with pytest.raises(ValueError, match="target_triangles"):
        o3d_sofnn.reconstruct_surface(cloud, target_triangles=3)
