"""Sides of points from the winding number alone."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import CLOSED, Shape, box, sphere

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.orientation.winding_normals import (
    orient_points,
    representatives,
    winding_number_normals,
)
from o3d_sofnn.sampling.cells import sort_unique
from o3d_sofnn.sampling.scales.choice import Limits, choose_scale


def oriented(shape, noise=0.0):
    """Share of points on the wrong side, and the normals in Morton order."""
    order, _ = sort_unique(shape.points)
    points = np.ascontiguousarray(shape.points[order])
    spacing = choose_scale(points, KdTree(points, 1), Limits()).spacing
    normals = orient_points(points, noise, float(np.median(spacing)))
    return (np.einsum("nd,nd->n", normals, shape.normals[order]) < 0.0).mean(), normals


@pytest.mark.parametrize("name", CLOSED)
def test_points_are_oriented_without_any_fit(name):
    wrong, normals = oriented(CLOSED[name])
    assert wrong == 0.0
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)


def test_noise_as_thick_as_a_quarter_of_a_rod():
    rod = box(4000, (2.0, 0.1, 0.1))
    noisy = rod.noisy(0.025)
    # Whoever knows the rod and takes the face nearest to the point is wrong this often.
    across = noisy.points[:, 1:] * rod.normals[:, 1:]
    beyond = (across.sum(axis=1) < 0.0).mean()
    assert 0.01 < beyond < 0.04
    assert oriented(noisy, 0.025)[0] < 2.0 * beyond


def test_sparse_regions_get_a_wider_smoothing():
    shape = sphere(40_000)
    rng = np.random.default_rng(0)
    kept = rng.random(len(shape.points)) < 0.1 + 0.9 * (shape.points[:, 0] > 0.0)
    thinned = Shape(shape.points[kept], shape.normals[kept]).noisy(0.02)
    assert oriented(thinned, 0.02)[0] < 0.003


@pytest.mark.parametrize("noise", [0.0, 0.015])
def test_two_shells_one_inside_the_other(noise):
    radii, signs = (0.96, 0.84, 0.6, 0.5), (1.0, -1.0, 1.0, -1.0)
    spheres = [sphere(int(6000 * radius**2)) for radius in radii]
    shells = Shape(
        np.concatenate([radius * s.points for radius, s in zip(radii, spheres, strict=True)]),
        np.concatenate([sign * s.normals for sign, s in zip(signs, spheres, strict=True)]),
    )
    assert oriented(shells.noisy(noise), noise)[0] < 0.01


def test_winding_number_normals_are_outward_and_weighted_by_area():
    points, normals = sphere(1500)
    mu = winding_number_normals(points, np.ones(1500), np.full(1500, 0.27), np.full(1500, 0.063))
    length = np.linalg.norm(mu, axis=1)
    cosine = (mu * normals).sum(axis=1) / length
    assert (cosine > 0.9).all()
    assert length.sum() == pytest.approx(4.0 * np.pi, rel=0.2)


def test_few_representatives_stand_for_many_points():
    points = sphere(40_000).points
    places, stands = representatives(points, 0.0)
    assert len(points) / 8 < len(places) < len(points) / 2
    assert np.abs(np.linalg.norm(places, axis=1) - 1.0).max() < 0.01
    count = np.bincount(stands, minlength=len(places))
    means = np.stack([np.bincount(stands, column) / count for column in points.T], axis=1)
    np.testing.assert_allclose(places, means, atol=1e-12)
    few = sphere(50).points
    assert representatives(few, 0.0)[0] is few


def test_representatives_of_a_thick_layer_are_some_of_its_points():
    points = sphere(40_000).points
    points = points[sort_unique(points)[0]]
    places, stands = representatives(points, 9.0)
    assert len(places) == len(representatives(points, 0.0)[0])
    # In the same order, evenly spread.
    rows = KdTree(points, 1).query(places, 1, np.inf)[1][:, 0]
    np.testing.assert_array_equal(points[rows], places)
    assert np.ptp(np.diff(rows)) <= 1
    assert np.abs(rows[stands] - np.arange(len(points))).max() <= np.diff(rows).max()
