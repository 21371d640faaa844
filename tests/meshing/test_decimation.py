"""Fewer triangles, the same topology, the same surface."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_checks import assert_valid_mesh
from shapes import plane_patch, sphere, torus

import o3d_sofnn
from o3d_sofnn import _kernels, adapters, reference
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.meshing.borders.trimming import cut
from o3d_sofnn.meshing.decimation import decimate, unmet
from o3d_sofnn.meshing.isosurface.extraction import extract
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


def test_sheets_that_are_near_do_not_cut_each_other():
    def ball(x):
        return np.linalg.norm(x, axis=1) - 1.0, np.ones(len(x))

    outer, triangles = extract(ball, sphere(4000).points, 0.1)
    outer /= np.linalg.norm(outer, axis=1)[:, None]
    inner = 0.99 * outer[:, [1, 2, 0]]
    count, turned = len(triangles) // 20, triangles[:, ::-1]

    def joined(one, other):
        return np.concatenate([one[0], other[0]]), np.concatenate([one[1], other[1] + len(one[0])])

    alone = joined(
        decimate(outer, triangles, count), decimate(inner, np.ascontiguousarray(turned), count)
    )
    everything = np.ones(len(alone[1]), bool)
    assert len(_kernels.intersecting_pairs(*alone, everything, 1)) > 50
    together = decimate(*joined((outer, triangles), (inner, turned)), 2 * count)
    assert 2 * count - 1 <= len(together[1]) <= 2 * count
    assert_valid_mesh(*together[:2], components=2)


def wavy(x):
    values = np.hypot(np.hypot(x[:, 0], x[:, 1]) - 1.0, x[:, 2]) - 0.4
    return values + 0.1 * np.sin(5.0 * x).sum(axis=1), np.ones(len(x))


@pytest.mark.parametrize("is_open", [False, True])
@pytest.mark.parametrize("share", [0.5, 0.0])
def test_kernel_and_twin(is_open, share):
    vertices, triangles = extract(wavy, torus(2000).points, 0.45)
    vertices = vertices + np.random.default_rng(0).normal(0.0, 0.002, vertices.shape)
    if is_open:
        side = np.clip(0.5 + vertices[:, 2], 0.0, 1.0)
        vertices, triangles = cut(vertices, triangles, side, side, 0.5)[:2]
    target = int(share * len(triangles))
    found = [np.asarray(x) for x in _kernels.decimate(vertices, triangles, target, 1)]
    expected = reference.decimate(vertices, triangles, target)
    np.testing.assert_allclose(found[0], expected[0], rtol=0.0, atol=1e-9)
    for array, other in zip(found[1:], expected[1:], strict=True):
        np.testing.assert_array_equal(array, other)
    assert len(found[1]) <= max(target, 30)


def test_what_cuts_others_already_is_left_as_it_is():
    vertices, triangles = extract(wavy, torus(2000).points, 0.2)
    both = np.concatenate([vertices, vertices + np.array([0.3, 0.0, 0.1])])
    doubled = np.concatenate([triangles, triangles + len(vertices)]).astype(np.int32)
    places, fewer, _ = decimate(both, doubled, len(doubled) // 4)
    assert_valid_mesh(places, fewer, components=2, apart=False)


def test_a_target_that_is_not_met_is_a_warning():
    points = torus(2000).points
    surface = reconstruct_surface(points, target_triangles=4)
    count = len(surface.triangles)
    assert_valid_mesh(surface.vertices, surface.triangles, components=1)
    assert 4 < count < 100
    assert f"target_triangles=4 was not reached: {count}" in surface.normals.warnings[-1]
    assert unmet(count, count) == unmet(None, count) == ()
    assert reconstruct_surface(points, target_triangles=count).normals.warnings == ()


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
