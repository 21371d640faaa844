"""Rims: straight, with edges as long as the spacing, and nothing else changes."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import sphere

from o3d_sofnn import _kernels
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.meshing.borders.rims import AWAY, EDGE, straightened, tidy
from o3d_sofnn.meshing.borders.trimming import cut, smoothed
from o3d_sofnn.meshing.isosurface.extraction import extract

SPACING = 0.1


@pytest.fixture(scope="module")
def ball():
    points = sphere(3000).points
    return extract(lambda x: (np.linalg.norm(x, axis=1) - 1.0, np.ones(len(x))), points, 0.08)


def trimmed(ball, values, level=0.0):
    vertices, triangles = ball
    return cut(vertices, triangles, np.ones(len(vertices)), values, level)[:2]


def border_edges(vertices, triangles):
    edges = mesh_properties.boundary_edges(triangles)
    return np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)


def assert_same_kind(before, after):
    vertices, triangles = after
    assert mesh_properties.is_edge_manifold(triangles)
    assert mesh_properties.is_vertex_manifold(triangles)
    assert mesh_properties.is_consistently_wound(triangles)
    assert not mesh_properties.has_repeated_indices(triangles)
    np.testing.assert_array_equal(np.unique(triangles), np.arange(len(vertices)))
    assert not len(
        _kernels.intersecting_pairs(vertices, triangles, np.ones(len(triangles), bool), 1)
    )
    for figure in (
        mesh_properties.euler_characteristic,
        lambda t: mesh_properties.component_labels(t)[0],
    ):
        assert figure(triangles) == figure(before[1])


def test_a_jagged_rim_becomes_straight(ball):
    rng = np.random.default_rng(0)
    before = trimmed(ball, 0.3 - ball[0][:, 2] + 0.05 * rng.normal(size=len(ball[0])))
    spacing = np.full(len(before[0]), SPACING)
    vertices, triangles, used = tidy(*before, spacing)
    assert_same_kind(before, (vertices, triangles))
    was, now = border_edges(*before), border_edges(vertices, triangles)
    assert len(now) < 0.4 * len(was)
    assert now.max() <= EDGE * SPACING + 1e-12
    assert now.sum() < was.sum()
    moved = np.linalg.norm(vertices - before[0][used], axis=1)
    assert moved.max() <= AWAY * SPACING + 1e-12
    border = np.zeros(len(before[0]), bool)
    border[mesh_properties.boundary_edges(before[1])] = True
    assert not moved[~border[used]].any()
    # Along the surface: a step of half a spacing leaves it by an eighth of its square.
    assert np.abs(np.linalg.norm(vertices, axis=1) - 1.0).max() < 0.01


@pytest.mark.parametrize("seed", range(4))
def test_any_rims_stay_manifold_and_no_triangle_turns(ball, seed):
    rng = np.random.default_rng(seed)
    before = trimmed(ball, np.round(rng.uniform(size=len(ball[0]))), 0.5)
    spacing = np.full(len(before[0]), SPACING)
    vertices, triangles, _ = tidy(*before, spacing)
    assert_same_kind(before, (vertices, triangles))
    straight = straightened(*before, spacing)
    was, now = (mesh_properties.area_vectors(x, before[1]) for x in (before[0], straight))
    assert (np.einsum("td,td->t", was, now) > 0.0).all()
    outwards = np.einsum(
        "td,td->t",
        mesh_properties.area_vectors(vertices, triangles),
        vertices[triangles].mean(axis=1),
    )
    assert (outwards > 0.0).mean() > 0.99


def test_what_is_closed_stays(ball):
    vertices, triangles, used = tidy(*ball, np.full(len(ball[0]), SPACING))
    np.testing.assert_array_equal(vertices, ball[0])
    np.testing.assert_array_equal(triangles, ball[1])
    np.testing.assert_array_equal(used, np.arange(len(vertices)))


def test_averages_remove_teeth_and_leave_borders_in_place(ball):
    vertices, triangles = ball
    teeth = (
        0.3
        - vertices[:, 2]
        + 0.08 * np.sign(np.sin(40.0 * np.arctan2(vertices[:, 1], vertices[:, 0])))
    )
    spacing = np.full(len(vertices), SPACING)
    even = smoothed(teeth, 0.0, vertices, triangles, spacing)
    rough, smooth = (trimmed(ball, values) for values in (teeth, even))
    heights = [x[np.unique(mesh_properties.boundary_edges(t))][:, 2] for x, t in (rough, smooth)]
    assert np.std(heights[1]) < 0.3 * np.std(heights[0])
    assert heights[1].mean() == pytest.approx(0.3, abs=0.03)
    far = vertices[:, 2] < -0.9
    np.testing.assert_array_equal(even[far], teeth[far])


def test_fixed_vertices_stay(ball):
    rng = np.random.default_rng(0)
    vertices, triangles = trimmed(ball, ball[0][:, 2] + 0.1 * rng.normal(size=len(ball[0])))
    fixed = vertices[:, 0] > 0.0
    spacing = np.full(len(vertices), SPACING)
    found, _, used = tidy(vertices, triangles, spacing, fixed)
    assert np.isin(np.flatnonzero(fixed), used).all()
    np.testing.assert_array_equal(found[fixed[used]], vertices[used][fixed[used]])
    assert (found[~fixed[used]] != vertices[used][~fixed[used]]).any()
