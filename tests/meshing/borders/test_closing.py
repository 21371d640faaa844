"""What stays closed: solids and what rims vouch for; what was not measured is open."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse
from mesh_checks import assert_valid_mesh
from scipy.sparse.csgraph import connected_components
from shapes import box, plane_patch, sphere, torus

from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.meshing.borders.solids import solids
from o3d_sofnn.pipeline import estimate_normals, reconstruct_surface


def pipe(n, length, radius=1.0, seed=0):
    """A tube along x without its ends."""
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0.0, 2.0 * np.pi, n)
    x = rng.uniform(-0.5 * length, 0.5 * length, n)
    return np.stack([x, radius * np.cos(turn), radius * np.sin(turn)], axis=1)


def sheet_with_hole(n, radius):
    points = plane_patch(n).points
    return points[np.linalg.norm(points[:, :2], axis=1) > radius]


def rims(surface):
    """Lengths of the rims, the longest one first."""
    edges = mesh_properties.boundary_edges(surface.triangles)
    n = len(surface.vertices)
    graph = scipy.sparse.coo_matrix((np.ones(len(edges)), edges.T), shape=(n, n))
    label = connected_components(graph, directed=False)[1][edges[:, 0]]
    x = surface.vertices[edges]
    length = np.bincount(label, np.linalg.norm(x[:, 0] - x[:, 1], axis=1))
    return np.sort(length[length > 0.0])[::-1]


def assert_open_manifold(surface):
    assert not surface.watertight
    assert mesh_properties.is_edge_manifold(surface.triangles)
    assert mesh_properties.is_vertex_manifold(surface.triangles)
    assert mesh_properties.is_consistently_wound(surface.triangles)
    assert len(np.unique(surface.triangles)) == len(surface.vertices)
    assert surface.quality.invented < 0.03
    assert surface.quality.near > 0.97


def test_the_winding_number_knows_solids_from_sheets():
    ball, ring = sphere(1500).points, torus(1500).moved((3.0, 0.0, 0.0)).points
    dish = sphere(1500).moved((0.0, 4.0, 0.0)).points
    dish = dish[dish[:, 2] < -0.6]
    sheet = plane_patch(1500, size=2.0).moved((5.0, 4.0, 0.0)).points
    points = np.concatenate([ball, ring, dish, sheet])
    of_rules, of_points = solids(estimate_normals(points).rules, points)
    np.testing.assert_array_equal(of_points, points[:, 1] < 2.0)
    assert of_rules.any()
    assert not of_rules.all()


@pytest.mark.parametrize("noise", [0.0, 0.005])
@pytest.mark.parametrize("shape", [sphere, torus, box], ids=lambda shape: shape.__name__)
def test_closed_shapes_are_closed_to_the_last_bit(shape, noise):
    points = shape(2500).noisy(noise).points
    chosen, closed = reconstruct_surface(points), reconstruct_surface(points, closed=True)
    np.testing.assert_array_equal(chosen.vertices, closed.vertices)
    np.testing.assert_array_equal(chosen.triangles, closed.triangles)
    assert_valid_mesh(chosen.vertices, chosen.triangles)
    assert chosen.closing.closed
    assert chosen.closing.unsupported == 0.0
    assert closed.closing is None


@pytest.mark.parametrize("length", [4.0, 16.0])
def test_both_ends_of_a_pipe_are_open_whatever_its_length(length):
    surface = reconstruct_surface(pipe(int(400 * length), length))
    assert_open_manifold(surface)
    assert mesh_properties.euler_characteristic(surface.triangles) == 0
    assert rims(surface) == pytest.approx([2.0 * np.pi] * 2, rel=0.04)
    assert surface.closing.holes_open == 2
    ends = surface.vertices[np.unique(mesh_properties.boundary_edges(surface.triangles))][:, 0]
    for side in (ends < 0.0, ends > 0.0):
        assert np.std(ends[side]) < 0.7 * surface.normals.spacing, "teeth"


def test_a_missing_patch_of_a_solid_is_closed_and_an_open_half_is_not():
    points = sphere(4000).points
    patch = reconstruct_surface(points[points[:, 2] < 0.93])
    assert_valid_mesh(patch.vertices, patch.triangles)
    assert 0.01 < patch.closing.unsupported < 0.06
    half = reconstruct_surface(points[points[:, 2] < 0.1])
    assert_open_manifold(half)
    assert len(rims(half)) == 1
    closed = reconstruct_surface(points[points[:, 2] < 0.1], closed=True)
    assert_valid_mesh(closed.vertices, closed.triangles)
    open_ = reconstruct_surface(points[points[:, 2] < 0.93], closed=False)
    assert_open_manifold(open_)


def test_a_box_without_a_lid_has_none():
    points = box(5000).points
    surface = reconstruct_surface(points[points[:, 2] < 0.499])
    assert_open_manifold(surface)
    assert rims(surface) == pytest.approx([4.0], rel=0.06)


@pytest.mark.parametrize(("spacings", "euler"), [(3.5, 1), (8.0, 0)])
def test_rims_vouch_for_small_holes_only(spacings, euler):
    n = 4000
    surface = reconstruct_surface(sheet_with_hole(n, spacings / np.sqrt(n)))
    assert_open_manifold(surface)
    assert mesh_properties.euler_characteristic(surface.triangles) == euler
    bare = reconstruct_surface(sheet_with_hole(n, 5.0 / np.sqrt(n)), closed=False)
    assert mesh_properties.euler_characteristic(bare.triangles) == 0


def test_every_piece_is_judged_by_itself():
    tube = pipe(3200, 8.0)
    crumb = plane_patch(40, size=0.7).moved((0.0, 0.0, 3.0)).points
    ball = sphere(900).moved((0.0, 5.0, 0.0)).points
    surface = reconstruct_surface(np.concatenate([tube, crumb, ball]))
    count, label = mesh_properties.component_labels(surface.triangles)
    own = [surface.triangles[label == number] for number in range(count)]
    area = [mesh_properties.triangle_areas(surface.vertices, x).sum() for x in own]
    order = np.argsort(area)[::-1]
    # The tube, the ball and the crumb: no closed bubble.
    assert [mesh_properties.is_closed(own[i]) for i in order] == [False, True, False]
    assert [mesh_properties.euler_characteristic(own[i]) for i in order] == [0, 2, 1]
    assert surface.quality.invented < 0.01


def test_decisions_do_not_depend_on_place_size_and_pose():
    points = sphere(2000).points
    points = points[points[:, 2] < 0.3]
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    plain = reconstruct_surface(points)
    moved = reconstruct_surface(1e4 * (points @ turn.T) + [4e5, 5e6, 10.0])
    assert moved.closing.closed is plain.closing.closed is False
    assert moved.closing.unsupported == pytest.approx(plain.closing.unsupported, abs=0.02)
    assert len(rims(moved)) == len(rims(plain)) == 1


def test_the_reason_names_the_figure_and_the_other_choice():
    closed = reconstruct_surface(sphere(800).points).closing
    assert "0 %" in closed.reason
    assert "closed=False" in closed.reason
    sheet = reconstruct_surface(plane_patch(800).points).closing
    assert f"{100.0 * sheet.unsupported:.0f} %" in sheet.reason
    assert "closed=True" in sheet.reason
    assert not sheet.closed


def test_a_room_with_furniture_keeps_a_closed_object():
    room = box(6000, size=(4.0, 4.0, 2.5)).points
    room = room[room[:, 2] < 1.2]
    ball = sphere(1200, radius=0.4).points
    surface = reconstruct_surface(np.concatenate([room, ball]))
    count, label = mesh_properties.component_labels(surface.triangles)
    assert count == 2
    sizes = [mesh_properties.is_closed(surface.triangles[label == i]) for i in range(count)]
    assert sorted(sizes) == [False, True]
