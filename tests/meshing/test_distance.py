"""Distances of places from triangles."""

from __future__ import annotations

import numpy as np
import pytest

from o3d_sofnn import _kernels, reference


def soup(kind):
    rng = np.random.default_rng(0)
    vertices = rng.normal(size=(60, 3))
    if kind == "slivers":
        vertices[:, 1:] *= 1e-6
    triangles = np.array([rng.choice(60, 3, replace=False) for _ in range(150)], np.int32)
    if kind == "points and lines":
        triangles[:, 2] = triangles[:, 1]
        triangles[::2, 1:] = triangles[::2, :1]
    return vertices, triangles, 2.0 * rng.normal(size=(300, 3))


@pytest.mark.parametrize("kind", ["triangles", "slivers", "points and lines"])
def test_kernel_and_twin(kind):
    vertices, triangles, x = soup(kind)
    expected = reference.nearest_triangles(vertices, triangles, x)[0]
    for n_threads in (1, 3):
        found = _kernels.nearest_triangles(vertices, triangles, x, n_threads)
        distance, nearest = map(np.asarray, found)
        np.testing.assert_allclose(distance, expected, rtol=1e-9)
        # Where two are equally near, rounding decides which one is named.
        for i in range(0, len(x), 10):
            named = reference.nearest_triangles(vertices, triangles[nearest[i]][None], x[i : i + 1])
            np.testing.assert_allclose(named[0], distance[i], rtol=1e-9)


def test_every_region_of_a_triangle():
    vertices = np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    x = np.array(
        [
            *([1.0, 1.0, 2.0], [1.0, 1.0, -2.0], [1.0, 1.0, 0.0]),
            *([-3.0, -4.0, 0.0], [7.0, -4.0, 0.0], [-3.0, 7.0, 0.0]),
            *([2.0, -1.0, 0.0], [-1.0, 2.0, 0.0], [2.0 + 3.0, 1.5 + 4.0, 0.0]),
        ]
    )
    triangles = np.array([[0, 1, 2]], np.int32)
    distance, nearest = _kernels.nearest_triangles(vertices, triangles, x, 1)
    np.testing.assert_allclose(distance, [2.0, 2.0, 0.0, 5.0, 5.0, 5.0, 1.0, 1.0, 5.0])
    np.testing.assert_array_equal(nearest, 0)


def test_of_equally_near_ones_the_first():
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    triangles = np.tile(np.array([[0, 1, 2]], np.int32), (9, 1))
    _, nearest = _kernels.nearest_triangles(vertices, triangles, np.eye(3), 1)
    np.testing.assert_array_equal(nearest, 0)


def test_no_triangle_is_infinitely_far():
    distance, nearest = _kernels.nearest_triangles(
        np.eye(3), np.zeros((0, 3), np.int32), np.eye(3), 1
    )
    np.testing.assert_array_equal(distance, np.inf)
    np.testing.assert_array_equal(nearest, 0)
