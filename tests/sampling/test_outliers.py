"""Outliers, found without being told of them."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import box, join, plane_patch, sphere, torus

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.pipeline import estimate_normals
from o3d_sofnn.rules.inference import infer_normals
from o3d_sofnn.rules.off_surface import distance_along_surface, off_surface
from o3d_sofnn.rules.rule_base import fit_rules
from o3d_sofnn.sampling.cells import sort_unique
from o3d_sofnn.sampling.local_fit import Neighborhoods
from o3d_sofnn.sampling.outliers import Samples, part_outliers
from o3d_sofnn.sampling.scales.choice import Limits, Scale

SHAPES = {"sphere": (sphere, 2.0), "plane": (plane_patch, 1.0), "torus": (torus, 2.8)}
"""Shape and the edge of its bounding box."""


def outliers_of(cloud):
    order, inverse = sort_unique(cloud)
    inliers = part_outliers(np.ascontiguousarray(cloud[order]), Limits()).kept
    return ~inliers[inverse]


@pytest.mark.parametrize("noise", [0.0, 0.005])
@pytest.mark.parametrize("name", SHAPES)
def test_uniform_outliers_are_found(name, noise):
    shape, size = SHAPES[name]
    points = shape(5000).noisy(noise * size).points
    center, edge = 0.5 * (points.min(axis=0) + points.max(axis=0)), 1.5 * size
    alone = center + np.random.default_rng(5).uniform(-0.5, 0.5, (50, 3)) * edge
    cloud = np.concatenate([points, alone])
    outlier = outliers_of(cloud)
    assert outlier[5000:].mean() > 0.6
    assert outlier[:5000].mean() < 0.002


def test_uneven_density_is_no_outlier():
    cloud = join(sphere(8000), sphere(300).moved((5.0, 0.0, 0.0))).points
    assert outliers_of(cloud).mean() < 0.002


@pytest.mark.parametrize("n", [1, 3, 4, 9])
def test_few_points_are_no_outliers(n):
    cloud = sphere(n).points
    assert not outliers_of(cloud).any()


@pytest.mark.parametrize("noise", [0.0, 0.004])
@pytest.mark.parametrize(("share", "least"), [(0.05, 0.87), (0.1, 0.87), (0.2, 0.8)])
@pytest.mark.parametrize("shape", [box, torus])
def test_many_outliers_are_found(shape, share, least, noise):
    points = shape(8000).noisy(noise).points
    size = np.ptp(points, axis=0)
    rng = np.random.default_rng(5)
    alone = rng.uniform(-0.6, 0.6, (int(8000 * share), 3)) * size
    outlier = estimate_normals(np.concatenate([points, alone])).outliers
    found = 2.0 * outlier[8000:].sum() / (outlier.sum() + len(alone))
    assert found > least  # F1; a third of the outliers lies within two spacings of the box
    assert outlier[:8000].mean() <= 0.002


@pytest.mark.parametrize("shape", [box, torus, sphere])
def test_strong_noise_is_no_outlier(shape):
    assert outliers_of(shape(8000).noisy(0.03).points).mean() < 0.001


def beside(residual, known, distance=None):
    """Ask for points of a plane with these residuals, with so many outliers known."""
    distance = residual if distance is None else distance
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (len(residual), 3)) * [1.0, 1.0, 0.1]
    tree, one = KdTree(points, 1), np.ones(1)
    places = points[:1]
    scale = Scale(places, KdTree(places, 1), np.array([12]), 0.01 * one, 0.01 * one, np.array([8]))
    inliers = np.concatenate([np.ones(len(points), bool), np.zeros(known, bool)])
    return off_surface(residual, distance, Samples(points, tree, scale, inliers))


def test_more_outliers_make_a_distant_point_more_suspicious():
    residual = np.zeros(2000)
    residual[:5] = 0.01 * np.array([1.9, 2.5, 3.0, 3.4, 3.6])
    few, many = beside(residual, 25)[:5], beside(residual, 50_000)[:5]
    assert (few[0], few[4], many[0], many[4]) == (False, True, False, True)
    assert few.sum() < many.sum()


def test_a_rule_that_follows_a_point_does_not_save_it():
    distance = np.zeros(2000)
    distance[:2] = 0.01 * np.array([4.9, 5.1])
    assert beside(np.zeros(2000), 25, distance)[:2].tolist() == [False, True]


def test_rules_that_few_points_support_are_not_asked_for_the_distance():
    shape = plane_patch(4000)
    points = np.concatenate([shape.points, [[0.0, 0.0, 0.1]]])
    facing = np.concatenate([shape.normals, [[0.0, 0.0, -1.0]]])
    centers = np.concatenate([shape.points[::20], points[-1:]])
    sides = np.concatenate([shape.normals[::20], facing[-1:]])
    size, noise = np.full(len(centers), 60), np.full(len(centers), 0.01)
    tree = KdTree(points, 1)
    where = Neighborhoods(centers, sides, size, noise)
    rules = fit_rules(tree, points, facing, where)
    followed = infer_normals(rules, points, sides=facing)[2]
    assert abs(followed[-1]) < 0.02
    along = distance_along_surface(rules, points, facing)
    assert along[-1] > 0.09
    assert along[:-1].max() < 1e-6


def test_what_a_whole_region_has_in_common_is_no_outlier():
    assert not beside(np.full(2000, 0.05), 100).any()
