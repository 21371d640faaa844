"""The self-check: figures with known values, and warnings below the limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from shapes import sphere

from o3d_sofnn.geometry.quality import ASKED, Inliers, assess
from o3d_sofnn.meshing.isosurface.extraction import extract
from o3d_sofnn.pipeline import reconstruct_surface


@pytest.fixture(scope="module")
def ball():
    points = sphere(3000).points
    return extract(lambda x: (np.linalg.norm(x, axis=1) - 1.0, np.ones(len(x))), points, 0.08)


def check(vertices, triangles, points, beyond=None, directions=None, reach=0.05):
    beyond = np.zeros(len(vertices)) if beyond is None else beyond
    inliers = Inliers.some(points, np.full(len(points), reach), directions)
    return assess(vertices, triangles, beyond, inliers)


def test_a_mesh_through_its_points(ball):
    found = check(*ball, sphere(500, seed=3).points)
    assert (found.near, found.invented, found.components, found.crumbs) == (1.0, 0.0, 1, 0)
    assert (found.border_edges, found.border_length, found.seen) == (0, 0.0, None)
    assert found.warnings(is_open=True) == ()


def test_distances_beside_and_above_a_mesh(ball):
    points = sphere(2000, seed=3).points
    outside = check(*ball, points * np.where(points[:, :1] > 0.0, 1.04, 1.06))
    assert outside.near == pytest.approx((points[:, 0] > 0.0).mean(), abs=1e-3)
    vertices, triangles = ball
    half = triangles[(vertices[triangles][:, :, 2] < 0.0).all(axis=1)]
    used, compact = np.unique(half, return_inverse=True)
    cut = check(vertices[used], compact.reshape(-1, 3).astype(np.int32), points)
    assert cut.near == pytest.approx((points[:, 2] < 0.02).mean(), abs=0.02)
    assert cut.border_length == pytest.approx(2.0 * np.pi, rel=0.15)
    assert cut.border_edges > 50
    assert any("within a spacing" in text for text in cut.warnings(is_open=True))


def test_invented_area_is_a_share_of_the_area(ball):
    vertices, triangles = ball
    found = check(vertices, triangles, sphere(500).points, beyond=1.2 * (vertices[:, 2] > 0.5))
    assert found.invented == pytest.approx(0.25, abs=0.03)
    assert any("closed=False" in text for text in found.warnings(is_open=True))
    assert found.warnings(is_open=False) == ()


def test_components_with_few_points_are_crumbs(ball):
    vertices, triangles = ball
    step = np.array([3.0, 0.0, 0.0])
    three = np.concatenate([vertices + i * step for i in range(3)])
    corners = np.concatenate([triangles + i * len(vertices) for i in range(3)]).astype(np.int32)
    points = np.concatenate([sphere(200).points, sphere(10).points + step])
    found = check(three, corners, points)
    assert (found.components, found.crumbs) == (3, 2)
    assert check(vertices, triangles, sphere(10).points).crumbs == 0  # all there is
    many = replace(found, crumbs=40)
    assert any("40 crumbs" in text for text in many.warnings(is_open=True))


def test_of_many_points_a_part_speaks():
    points = np.zeros((3 * ASKED, 3))
    inliers = Inliers.some(points, np.zeros(len(points)), points)
    assert len(inliers.points) <= ASKED
    assert inliers.weight * len(inliers.points) == pytest.approx(len(points))


def test_sides_that_were_seen(ball):
    points = sphere(1000, seed=5).points
    found = check(*ball, points, directions=np.array([0.0, 0.0, 9.0]) - points)
    assert found.seen == pytest.approx((points[:, 2] > 0.11 - 0.2).mean(), abs=0.03)
    assert any("viewpoint" in text for text in found.warnings(is_open=True))
    assert "face the viewpoint" in str(found)


def test_the_operator_checks_itself():
    points = sphere(1500).points
    top = points[points[:, 2] > 0.2]
    seen = reconstruct_surface(top, viewpoint=np.array([0.0, 0.0, 50.0]))
    assert seen.quality.seen > 0.99
    assert seen.quality.near > 0.99
    assert seen.quality.border_length == pytest.approx(2.0 * np.pi, rel=0.1)
    assert seen.warnings == ()
    wrong = reconstruct_surface(top, viewpoint=np.array([0.0, 0.0, 0.3]))
    assert wrong.quality.seen is not None
