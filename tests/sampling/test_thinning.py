"""Very dense noisy clouds: one point stands for a cell, and nothing gets worse."""

import numpy as np
import pytest
from shapes import plane_patch, sphere

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.pipeline import estimate_normals
from o3d_sofnn.sampling.normalization import unit_cube
from o3d_sofnn.sampling.outliers import part_outliers
from o3d_sofnn.sampling.scales.choice import Limits
from o3d_sofnn.sampling.scales.thinning import DENSE, FEWEST, thinned


def thinned_once(points):
    cloud = unit_cube(points)
    return cloud, thinned(cloud, part_outliers(cloud.points, Limits(), cloud.near))


def error(found, truth):
    """Root-mean-square angle in degrees, without sides."""
    cosine = np.abs(np.einsum("nd,nd->n", found, truth))
    return np.degrees(np.sqrt(np.mean(np.arccos(np.clip(cosine, 0.0, 1.0)) ** 2)))


@pytest.mark.parametrize("noise", [0.0, 0.002, 0.01])
def test_clouds_of_usual_density_stay(noise):
    cloud, fewer = thinned_once(sphere(20_000).noisy(noise).points)
    assert fewer is cloud


def test_cells_follow_the_density_and_lose_no_point():
    points = plane_patch(60_000).noisy(0.035).points
    cloud, fewer = thinned_once(points)
    assert len(cloud.points) / 64 < len(fewer.points) < len(cloud.points) / FEWEST * np.sqrt(2.0)
    same = fewer.points * cloud.extent + cloud.middle
    np.testing.assert_allclose(points[fewer.first], same, atol=1e-14)
    assert np.array_equal(np.unique(fewer.inverse), np.arange(len(fewer.points)))
    np.testing.assert_array_equal(fewer.inverse[fewer.first], np.arange(len(fewer.points)))
    step = np.linalg.norm(points - points[fewer.first][fewer.inverse], axis=1)
    assert np.percentile(step, 99) < 2.0 * 0.035
    # Every part of the sheet keeps its share of the points, and no corner of the cells is favoured.
    for axis in range(3):
        before, after = points[:, axis], points[fewer.first, axis]
        quartiles = np.percentile(before, [25, 50, 75])
        np.testing.assert_allclose(np.percentile(after, [25, 50, 75]), quartiles, atol=0.01)


def test_a_few_outliers_stay_what_they_are():
    rng = np.random.default_rng(0)
    far = rng.uniform(-0.5, 0.5, (20, 3)) + np.array([0.0, 0.0, 2.0])
    points = np.concatenate([plane_patch(60_000).noisy(0.035).points, far])
    _, fewer = thinned_once(points)
    assert np.isin(np.arange(60_000, 60_020), fewer.first).all()


@pytest.mark.parametrize("n", [6_000, 60_000])
def test_normals_of_a_noisy_open_sheet_lie_as_it_does(n):
    shape = plane_patch(n)
    inner = (np.abs(shape.points[:, :2]) < 0.4).all(axis=1)
    found = estimate_normals(shape.noisy(0.015).points).normals
    assert error(found[inner], shape.normals[inner]) < 3.0


def test_more_points_with_the_same_noise_make_nothing_worse():
    shape, few = sphere(80_000), slice(0, 8_000)
    points = shape.noisy(0.12).points
    dense = estimate_normals(points).normals
    sparse = estimate_normals(points[few]).normals
    assert DENSE * np.sqrt(FEWEST) * np.sqrt(4.0 * np.pi / 80_000) < 0.12  # it is thinned
    assert error(dense, shape.normals) < 1.05 * error(sparse, shape.normals[few])


@pytest.mark.parametrize("n", [0, 1, 16, 17, 1000])
def test_the_order_of_a_tree_keeps_branches_together(n):
    points = np.random.default_rng(n).normal(size=(n, 3))
    tree = KdTree(points, 1)
    order = np.asarray(tree.order())
    assert sorted(order) == list(range(n))
    for level in range(tree.depth):
        for i in range(2**level):
            low, middle, high = (
                ((2 * i * n) >> (level + 1)),
                ((2 * i + 1) * n) >> (level + 1),
                ((i + 1) * n) >> level,
            )
            one, other = points[order[low:middle]], points[order[middle:high]]
            both = np.concatenate([one, other])
            axis = np.ptp(both, axis=0).argmax()
            assert one[:, axis].max() <= other[:, axis].min()
