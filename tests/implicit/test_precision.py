"""The precision of local surfaces, epsilon of Algorithm 2, as the caller gives it."""

from __future__ import annotations

import numpy as np
import pytest
import shapes

from o3d_sofnn import pipeline

EPSILON = 6e-4  # of the paper, here in parts of the diagonal


def reconstruct(count, precision):
    points = shapes.torus(count).points
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    limit = None if precision is None else precision * diagonal
    return pipeline.reconstruct_surface(points, precision=limit, voxel_size=diagonal / 40)


def test_a_coarser_precision_takes_fewer_offset_points():
    counts = [reconstruct(2000, precision).offset_points for precision in (1e-5, 1e-4, 1e-3)]
    assert counts[0] > counts[1] > counts[2]
    assert reconstruct(2000, 1.0).offset_points == 0


def test_offset_points_at_the_papers_precision_grow_slower_than_the_points():
    few, many = (reconstruct(count, EPSILON).offset_points for count in (1500, 6000))
    assert many <= 0.2 * 6000
    assert many < 4 * max(few, 1)


@pytest.mark.parametrize("precision", [None, EPSILON])
def test_a_unit_has_at_most_one_offset_point(precision):
    estimate = reconstruct(1000, precision)
    assert 0 < estimate.offset_points <= 2 * len(estimate.normals.rules)  # divided once at most
    assert estimate.watertight


def test_noise_is_not_followed_but_shape_is():
    shape = shapes.sphere(4000)
    noisy = shape.noisy(0.02).points
    assert pipeline.reconstruct_surface(noisy, voxel_size=0.1).offset_points < 5
    clean = shapes.box(4000).points
    assert pipeline.reconstruct_surface(clean, voxel_size=0.05).offset_points > 50
