"""Areas that samples cover."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import sphere

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.geometry.neighbors import LEAST, neighborhood_areas


def test_areas_of_samples_sum_to_that_of_the_surface():
    points = sphere(4000).points
    areas = neighborhood_areas(points, KdTree(points, 1))
    assert areas.sum() == pytest.approx(4.0 * np.pi, rel=0.1)


@pytest.mark.parametrize("count", [1, 20])
def test_samples_in_one_place_have_an_area(count):
    points = np.zeros((count, 3))
    np.testing.assert_array_equal(neighborhood_areas(points, KdTree(points, 1)), LEAST)
