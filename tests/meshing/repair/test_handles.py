"""Handles too small for the data are opened, others stay, and nothing falls apart."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_checks import assert_valid_mesh
from shapes import sphere, torus

from o3d_sofnn import _kernels, reference
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.meshing.isosurface.extraction import extract
from o3d_sofnn.meshing.repair.handles import open_handles
from o3d_sofnn.meshing.repair.relaxation import relax

SIZE = 0.05


def ring(x, middle, axis, major, minor):
    """Distance from a torus."""
    along = (x - middle) @ np.asarray(axis, float)
    across = np.linalg.norm(x - middle - along[:, None] * axis, axis=1)
    return np.hypot(across - major, along) - minor


def ball_with_handles(number):
    """A unit ball with small handles around the equator, genus `number`."""

    def distance(x):
        values = np.linalg.norm(x, axis=1) - 1.0
        for angle in np.arange(number) * 2.0 * np.pi / max(number, 1):
            middle = np.array([np.cos(angle), np.sin(angle), 0.0])
            side = np.array([-np.sin(angle), np.cos(angle), 0.0])
            values = np.minimum(values, ring(x, middle, side, 0.17, 0.08))
        return values, np.ones(len(x))

    return distance


def extracted(function, seeds, size=SIZE):
    vertices, triangles = extract(function, seeds, size)
    return relax(vertices, triangles, function)[0], triangles


def genus(triangles):
    return 1 - mesh_properties.euler_characteristic(triangles) // 2


@pytest.mark.parametrize("number", [0, 1, 5])
def test_small_handles_are_opened(number):
    before, triangles = extracted(ball_with_handles(number), sphere(6000).points)
    assert genus(triangles) == number
    after, opened, source = open_handles(before, triangles, lambda x: np.full(len(x), 0.12))
    assert_valid_mesh(after, opened, components=1)
    assert genus(opened) == 0
    assert len(source) == len(after)
    np.testing.assert_array_equal(source[: len(before)], np.arange(len(before)))
    assert np.linalg.norm(after - before[source], axis=1).max() < 6 * SIZE
    far = np.linalg.norm(before[:, :2], axis=1) < 0.5
    np.testing.assert_array_equal(after[: len(before)][far], before[far])


def test_handles_with_room_for_samples_stay():
    before, triangles = extracted(ball_with_handles(3), sphere(6000).points)
    after, same, _ = open_handles(before, triangles, lambda x: np.full(len(x), 0.03))
    np.testing.assert_array_equal(same, triangles)
    np.testing.assert_array_equal(after, before)
    place = before[triangles.ravel()[np.asarray(_kernels.handle_edges(before, triangles))]]
    angle = np.unique(np.round(np.arctan2(place[:, 1], place[:, 0]) / (2.0 * np.pi / 3.0)))
    assert len(angle) == 3  # each handle has edges beside it


def test_bridges_between_two_sheets_are_opened_and_the_last_one_stays():
    places = np.array([[-0.6, -0.5], [0.6, -0.4], [0.0, 0.6], [0.1, 0.0]])

    def two_plates(x):
        plate = np.maximum(abs(x[:, :2]).max(axis=1) - 1.0, abs(abs(x[:, 2]) - 0.4) - 0.3)
        away = np.linalg.norm(x[:, None, :2] - places, axis=2).min(axis=1)
        return np.minimum(plate, np.maximum(away - 0.08, abs(x[:, 2]) - 0.3)), np.ones(len(x))

    before, triangles = extracted(two_plates, np.random.default_rng(0).uniform(-1, 1, (9000, 3)))
    assert genus(triangles) == 3
    # The loop through two bridges is longer than what the data cannot tell: all of them stay.
    kept = open_handles(before, triangles, lambda x: np.full(len(x), 0.1))[1]
    assert genus(kept) == 3
    after, opened, _ = open_handles(before, triangles, lambda x: np.full(len(x), 0.5))
    assert_valid_mesh(after, opened, components=1)
    assert genus(opened) == 0


def rough(function, seed):
    vertices, triangles = extract(function, sphere(4000).points, 0.09)
    rng = np.random.default_rng(seed)
    return vertices + rng.normal(0.0, 0.01, vertices.shape), triangles


@pytest.mark.parametrize("number", [0, 1, 3])
@pytest.mark.parametrize("radius", [0.1, 0.4])
def test_kernels_agree_with_their_twins(number, radius):
    vertices, triangles = rough(ball_with_handles(number), number)
    edges = np.asarray(_kernels.handle_edges(vertices, triangles))
    np.testing.assert_array_equal(edges, reference.handle_edges(vertices, triangles))
    assert edges.shape == (2 * number,)
    args = vertices, triangles, edges, np.full(len(edges), radius), len(triangles)
    found = [np.asarray(x) for x in _kernels.open_handles(*args)]
    expected = reference.open_handles(*args)
    np.testing.assert_allclose(found[0], expected[0], rtol=0.0, atol=1e-14)
    for array, other in zip(found[1:], expected[1:], strict=True):
        np.testing.assert_array_equal(array, other)
    assert genus(found[1]) == (number if radius == 0.1 else 0)


def on_torus(x):
    return ring(x, np.zeros(3), np.array([0.0, 0.0, 1.0]), 1.0, 0.4), np.ones(len(x))


def test_a_torus_is_cut_around_its_tube():
    before, triangles = extracted(on_torus, torus(6000).points)
    edges = np.asarray(_kernels.handle_edges(before, triangles))[:1]
    opened = _kernels.open_handles(before, triangles, edges, np.full(1, 9.0), len(triangles))
    after, closed, _, touched = map(np.asarray, opened)
    assert_valid_mesh(after, closed, components=1, apart=False)  # one lid lies on the other
    assert genus(closed) == 0
    distance, _ = on_torus(after[touched > 0])
    assert np.sort(abs(distance))[:-2].max() < 0.02  # the loop is on the surface
    angle = np.arctan2(after[touched > 0, 1], after[touched > 0, 0])
    assert abs(np.exp(1j * angle).mean()) > 0.98  # and at one place of the ring


def test_no_patch_has_more_triangles_than_a_small_handle_can_have():
    vertices, triangles = extract(on_torus, torus(6000).points, SIZE)
    edges = np.asarray(_kernels.handle_edges(vertices, triangles))[:1]
    args = vertices, triangles, edges, np.full(1, 9.0), 4096
    found, expected = _kernels.open_handles(*args), reference.open_handles(*args)
    np.testing.assert_array_equal(found[1], expected[1])
    np.testing.assert_array_equal(found[1], triangles)  # half of a ring has no handle
