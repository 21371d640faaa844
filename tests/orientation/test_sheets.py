"""Sides of normals, from positions alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from shapes import (
    CLOSED,
    Shape,
    box,
    inside_out,
    join,
    plane_patch,
    sphere,
    torus,
    two_spheres,
)

from o3d_sofnn.orientation.components import pieces, turn_along
from o3d_sofnn.orientation.confidence import RIM, at_border, empty_in_front
from o3d_sofnn.pipeline import estimate_normals
from o3d_sofnn.reference.sampling.local_fit import frame_of
from o3d_sofnn.rules.rule_base import RuleBase


def rules_on(shape, seed=0):
    """Flat rules on exact positions, sides of their normals drawn at random."""
    n = len(shape.points)
    side = np.random.default_rng(seed).choice([-1.0, 1.0], (n, 1))
    reach = cKDTree(shape.points).query(shape.points, min(20, n))[0][:, -1]
    return RuleBase(
        centers=shape.points,
        frames=np.array([frame_of(normal) for normal in side * shape.normals]),
        coefficients=np.zeros((n, 6)),
        radius=1.1 * reach,
        stretch=np.ones(n),
        support=np.ones(n),
        residual=np.zeros(n),
        noise=np.zeros(n),
        n_neighbors=np.full(n, 20),
        confidence=np.ones(n),
    )


def flipped(normals, shape):
    return float(((normals * shape.normals).sum(axis=1) < 0.0).mean())


@pytest.mark.parametrize("name", ["torus", "thin plate"])
def test_sides_of_points_follow_turned_rules(name):
    shape = CLOSED[name]
    rules = rules_on(shape).facing(shape.normals)
    left = shape.points[:, 0] < 0.0
    side = np.where(left, -1.0, 1.0)[:, None] * shape.normals
    none, every = np.zeros(len(side), bool), np.ones(len(side), bool)
    turned = turn_along(shape.normals, shape.points, rules, rules.facing(side), none)
    np.testing.assert_array_equal(turned, side)
    assert turn_along(side, shape.points, rules, rules, none) is side
    followed = turn_along(side, shape.points, rules, rules, every)
    np.testing.assert_array_equal(followed, shape.normals)


@pytest.mark.parametrize(("noise", "bound"), [(0.0, 0.0), (0.005, 0.0), (0.02, 0.002)])
@pytest.mark.parametrize("name", CLOSED)
def test_normals_of_points_face_outwards(name, noise, bound):
    # A plate of 0.1 with a noise of 0.02 has points of one side beyond the middle.
    limit = {0.0: 0.0, 0.005: 0.001, 0.02: 0.02}[noise] if name == "thin plate" else bound
    shape = CLOSED[name]
    normals = estimate_normals(shape.noisy(noise).points, n_threads=1).normals
    assert flipped(normals, shape) <= limit


def test_sheets_one_fiftieth_apart_are_told_apart():
    shape = box(20_000, (1.0, 1.0, 0.02))
    assert flipped(estimate_normals(shape.points, n_threads=1).normals, shape) < 0.002


def bowl(n):
    """The lower half of a sphere, open."""
    shape = sphere(2 * n)
    low = shape.points[:, 2] < 0.0
    return shape._replace(points=shape.points[low], normals=shape.normals[low])


def hills(n):
    """A wavy sheet over a square."""
    x, y, _ = plane_patch(n, 4.0).points.T
    points = np.stack([x, y, 0.2 * np.sin(3.0 * x) * np.cos(3.0 * y)], axis=1)
    slope_x = 0.6 * np.cos(3.0 * x) * np.cos(3.0 * y)
    slope_y = -0.6 * np.sin(3.0 * x) * np.sin(3.0 * y)
    normals = np.stack([-slope_x, -slope_y, np.ones(n)], axis=1)
    return Shape(points, normals / np.linalg.norm(normals, axis=1, keepdims=True))


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("sheet", [plane_patch(2000), hills(4000), bowl(1500)])
def test_open_sheets_have_one_side(sheet, noise):
    found = flipped(estimate_normals(sheet.noisy(noise).points, n_threads=1).normals, sheet)
    assert min(found, 1.0 - found) == 0.0


def test_the_sparse_part_of_a_closed_surface_counts_as_closed():
    dense, sparse = sphere(8000), sphere(80, seed=3).moved((5.0, 0.0, 0.0))
    shape = join(dense, sparse)
    empty = empty_in_front(rules_on(shape).facing(shape.normals))
    assert empty[:8000].mean() > 0.99
    assert empty[8000:].mean() > 0.95
    sheet = rules_on(plane_patch(900)).facing(plane_patch(900).normals)
    assert empty_in_front(sheet).mean() < 0.3


def test_far_objects_of_different_size_are_both_oriented():
    shape = join(sphere(1500), sphere(1500, radius=0.2, seed=1).moved((20.0, 0.0, 0.0)))
    assert flipped(estimate_normals(shape.points, n_threads=1).normals, shape) == 0.0


def test_pieces_are_the_connected_parts():
    label = pieces(rules_on(two_spheres(1000)))
    assert len(np.unique(label)) == 2
    assert len(np.unique(label[:500])) == 1
    assert len(np.unique(label[500:])) == 1
    assert len(np.unique(pieces(rules_on(torus(1000))))) == 1


@pytest.mark.parametrize("height", [20.0, -20.0])
def test_every_normal_faces_its_viewpoint(height):
    sheet = hills(3000).noisy(0.02)
    one = np.array([0.5, -0.5, height])
    each = one + np.random.default_rng(0).uniform(-0.2, 0.2, sheet.points.shape)
    for viewpoint in (one, each):
        found = estimate_normals(sheet.points, viewpoint=viewpoint)
        assert ((found.normals * (viewpoint - sheet.points)).sum(axis=1) >= 0.0).all()
        assert flipped(np.sign(height) * found.normals, sheet) <= 0.001
        assert found.warnings == ()


def test_two_sheets_seen_from_two_sides():
    """A board scanned from above and from below, thinner than its fits are wide."""
    up, down = plane_patch(3000), inside_out(plane_patch(3000, seed=1).moved((0.0, 0.0, -0.03)))
    board = join(up, down).noisy(0.005)
    viewpoint = np.repeat([[0.0, 0.0, 2.0], [0.0, 0.0, -2.0]], 3000, axis=0)
    shuffled = np.random.default_rng(0).permutation(6000)
    found = estimate_normals(board.points[shuffled], viewpoint=viewpoint[shuffled]).normals
    wrong = (found * board.normals[shuffled]).sum(axis=1) < 0.0
    rim = np.abs(board.points[shuffled, :2]).max(axis=1) > 0.45
    assert not wrong[~rim].any()
    assert wrong[rim].mean() < 0.1  # the winding number closes the board there


@pytest.mark.parametrize("sheet", [plane_patch(1000), plane_patch(1000).moved((0.0, 0.0, 7.0))])
def test_a_sheet_without_an_outer_side_faces_up_and_warns(sheet):
    for turn, up in ((np.eye(3)[[2, 0, 1]], 1), (np.eye(3)[[1, 2, 0]], 0)):
        found = estimate_normals(sheet.points @ turn)
        assert (found.normals[:, up] > 0.9).all()
        assert len(found.warnings) == 1
        assert found.warnings[0].startswith("100 % of the surface")
        assert (found.confidence == 0.0).all()
        told = estimate_normals(sheet.points @ turn, towards=-np.eye(3)[up])
        assert told.evidence.kind == "towards"
        assert (told.normals[:, up] < -0.9).all()
        assert told.warnings == ()
        assert np.median(told.confidence) > 0.5


@pytest.mark.parametrize("slope", [0.0, 0.1])
def test_level_ground_faces_up(slope):
    x, y, _ = plane_patch(4000, 4.0).points.T
    points = np.stack([x, y, slope * np.sin(3.0 * x) * np.cos(3.0 * y)], axis=1)
    found = estimate_normals(points)
    assert found.evidence.kind == "height field"
    assert (found.normals[:, 2] > 0.5).all()
    assert found.warnings == ()
    assert np.median(found.confidence) > 0.5


def test_terrain_that_is_steep_faces_up():
    found = estimate_normals(hills(4000).noisy(0.01).points)
    assert found.evidence.kind == "height field"
    assert flipped(found.normals, hills(4000)) == 0.0
    assert found.warnings == ()


def test_a_bowl_faces_its_outside_and_closed_surfaces_do_not_warn():
    for shape in (bowl(3000), *(CLOSED[name] for name in ("sphere", "box", "nested spheres"))):
        found = estimate_normals(shape.points)
        assert flipped(found.normals, shape) == 0.0
        assert found.warnings == ()
        assert found.evidence.kind == "outward"


def test_a_closed_object_above_a_plate_is_left_alone():
    shape = join(sphere(2000), plane_patch(2000, 4.0).moved((8.0, 0.0, 0.0)))
    found = estimate_normals(shape.points)
    assert flipped(found.normals, shape) == 0.0
    assert found.evidence.kind == "height field"
    assert 0.4 < found.evidence.figures["open"] < 0.7
    assert np.median(found.confidence[:2000]) > 0.8


def test_confidence_is_low_where_sides_are_uncertain():
    shape = box(8000, (1.0, 1.0, 0.04)).noisy(0.012)
    found = estimate_normals(shape.points)
    assert flipped(found.normals, shape) > 0.01
    assert ((found.confidence >= 0.0) & (found.confidence <= 1.0)).all()
    assert found.confidence.mean() < 0.5
    assert np.median(estimate_normals(torus(4000).points).confidence) > 0.8


def test_turned_rules_describe_the_same_surface():
    rng = np.random.default_rng(0)
    rules = replace(rules_on(sphere(50)), coefficients=rng.normal(0.0, 0.3, (50, 6)))
    turned = rules.facing(-rules.normals)
    np.testing.assert_allclose(turned.normals, -rules.normals, atol=1e-12)
    np.testing.assert_allclose(turned.feet, rules.feet, atol=1e-12)
    np.testing.assert_allclose(turned.curvatures, -rules.curvatures[:, ::-1], atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(turned.frames), 1.0, atol=1e-12)


@pytest.mark.parametrize("name", ["torus", "sphere", "box"])
def test_a_closed_surface_has_no_border(name):
    assert at_border(rules_on(CLOSED[name])).mean() < 0.5 * RIM


def test_the_border_of_a_sheet_is_found_and_nothing_else():
    sheet = plane_patch(900)
    rules = rules_on(sheet)
    found = at_border(rules)
    outside = np.abs(sheet.points[:, :2]).max(axis=1)
    assert found.mean() > 0.5 * RIM
    assert np.median(outside[found]) > 0.45, "the edge of the sheet is at 0.5"


def test_rules_without_neighbours_around_them_are_border():
    assert at_border(rules_on(sphere(2))).all()
