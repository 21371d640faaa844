"""Clouds whose points are much closer together than their noise is wide."""

import numpy as np
import pytest
from shapes import plane_patch, sphere

from o3d_sofnn.pipeline import estimate_normals


def error(found, truth):
    """Root-mean-square angle in degrees, without sides."""
    cosine = np.abs(np.einsum("nd,nd->n", found, truth))
    return np.degrees(np.sqrt(np.mean(np.arccos(np.clip(cosine, 0.0, 1.0)) ** 2)))


@pytest.mark.parametrize("n", [6_000, 60_000])
def test_normals_of_a_noisy_open_sheet_lie_as_it_does(n):
    shape = plane_patch(n)
    inner = (np.abs(shape.points[:, :2]) < 0.4).all(axis=1)
    found = estimate_normals(shape.noisy(0.015).points).normals
    assert error(found[inner], shape.normals[inner]) < 3.0


def test_more_points_with_the_same_noise_make_nothing_worse():
    shape, few = sphere(60_000), slice(0, 6_000)
    points = shape.noisy(0.05).points
    dense = estimate_normals(points).normals
    sparse = estimate_normals(points[few]).normals
    assert error(dense, shape.normals) < error(sparse, shape.normals[few])
