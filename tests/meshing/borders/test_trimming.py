"""Cuts along a line of equal confidence: clean borders, and what "auto" leaves closed."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import plane_patch, sphere

from o3d_sofnn import adapters, reconstruct_surface, validation
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.meshing.borders.trimming import cut, drop_strays, smoothed
from o3d_sofnn.meshing.isosurface.extraction import extract
from o3d_sofnn.pipeline import reconstruct_surface as reconstruct


def ball():
    points = sphere(4000).points
    return extract(lambda x: (np.linalg.norm(x, axis=1) - 1.0, np.ones(len(x))), points, 0.08)


def border_of(vertices, triangles):
    edges = mesh_properties.boundary_edges(triangles)
    assert (np.bincount(edges.ravel())[np.unique(edges)] == 2).all(), "borders are no simple curves"
    return vertices[np.unique(edges)]


def assert_open_manifold(vertices, triangles):
    assert mesh_properties.is_edge_manifold(triangles)
    assert mesh_properties.is_vertex_manifold(triangles)
    assert mesh_properties.is_consistently_wound(triangles)
    assert not mesh_properties.has_repeated_indices(triangles)
    assert len(np.unique(triangles)) == len(vertices)


@pytest.mark.parametrize("level", [0.2, 0.5, 0.9])
def test_the_border_is_the_line_of_equal_confidence(level):
    vertices, triangles = ball()
    confidence = np.clip(0.5 - 0.8 * vertices[:, 2], 0.0, 1.0)
    vertices, triangles, confidence, _ = cut(vertices, triangles, confidence, confidence, level)
    assert_open_manifold(vertices, triangles)
    border = border_of(vertices, triangles)
    assert np.ptp(border[:, 2]) < 0.05, "teeth as long as the cubes"
    assert abs(border[:, 2].mean() - (0.5 - level) / 0.8) < 0.04
    assert confidence.min() > level - 0.1


def test_any_confidence_leaves_a_manifold_without_slivers():
    vertices, triangles = ball()
    for seed in range(3):
        noise = np.random.default_rng(seed).uniform(size=len(vertices))
        left = cut(vertices, triangles, noise, np.round(noise), 0.5)
        assert_open_manifold(*left[:2])
        border_of(*left[:2])


def test_all_or_nothing():
    vertices, triangles = ball()
    ones = np.ones(len(vertices))
    kept = cut(vertices, triangles, ones, ones, 0.5)
    np.testing.assert_array_equal(kept[1], triangles)
    assert len(cut(vertices, triangles, ones, 0.0 * ones, 0.5)[1]) == 0


@pytest.mark.parametrize(("height", "closed"), [(0.95, True), (0.3, False)])
def test_auto_leaves_small_holes_closed(height, closed):
    points = sphere(6000).points
    surface = reconstruct(points[points[:, 2] < height], trim="auto")
    assert surface.watertight is closed
    assert_open_manifold(surface.vertices, surface.triangles)
    if not closed:
        assert np.ptp(border_of(surface.vertices, surface.triangles)[:, 2]) < 0.15


def test_auto_makes_a_sheet_of_a_sheet():
    points = plane_patch(2000).points
    surface = reconstruct(points, trim="auto")
    assert_open_manifold(surface.vertices, surface.triangles)
    assert np.abs(surface.vertices[:, 2]).max() < surface.voxel_size
    assert mesh_properties.euler_characteristic(surface.triangles) == 1


def test_strays_go():
    vertices, triangles = ball()
    both = np.concatenate([vertices, vertices + 5.0])
    doubled = np.concatenate([triangles, triangles + len(vertices)]).astype(np.int32)
    kept, used = drop_strays(both, doubled, sphere(500).points)
    np.testing.assert_array_equal(kept, triangles)
    np.testing.assert_array_equal(used, np.arange(len(vertices)))


def test_the_operators_take_auto(make_cloud, family):
    points = sphere(2000).points
    mesh = reconstruct_surface(make_cloud(points[points[:, 2] < 0.0], family), trim="auto")
    _, triangles = adapters.read_mesh(mesh)
    assert len(mesh_properties.boundary_edges(triangles)) > 0
    with pytest.raises(ValueError, match="trim"):
        validation.check_trim("some")


def test_new_vertices_are_on_the_edges_that_are_named():
    vertices, triangles = ball()
    height = vertices[:, 2]
    found, _, _, ends = cut(vertices, triangles, height, height, 0.2)
    same = ends[:, 0] == ends[:, 1]
    np.testing.assert_array_equal(found[same], vertices[ends[same, 0]])
    a, b = vertices[ends[~same]].transpose(1, 0, 2)
    along = np.linalg.norm(found[~same] - a, axis=1) + np.linalg.norm(found[~same] - b, axis=1)
    np.testing.assert_allclose(along, np.linalg.norm(a - b, axis=1))
    assert ((height[ends[~same]] < 0.2).sum(axis=1) == 1).all()


def test_values_of_fixed_vertices_are_not_smoothed():
    vertices, triangles = ball()
    values = np.sign(vertices[:, 2]) + 0.1
    fixed = vertices[:, 0] > 0.0
    result = smoothed(values, 0.0, vertices, triangles, np.full(len(values), 0.2), fixed)
    np.testing.assert_array_equal(result[fixed], values[fixed])
    assert (result[~fixed] != values[~fixed]).any()
