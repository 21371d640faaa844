"""Sharp edges get vertices on them; what is smooth stays as it is."""

from __future__ import annotations

import numpy as np
from mesh_checks import assert_valid_mesh
from shapes import sphere

from o3d_sofnn.geometry.mesh_properties import signed_volume
from o3d_sofnn.meshing.isosurface.extraction import extract
from o3d_sofnn.meshing.repair.relaxation import relax
from o3d_sofnn.meshing.repair.sharpening import sharpen, touching_planes
from o3d_sofnn.meshing.repair.untangling import untangle

TILTED = np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0]


def cube(x):
    """Largest distance from the planes of a tilted cube with edges of length 2."""
    return abs(x @ TILTED).max(axis=1) - 1.0, np.ones(len(x))


def distance(x):
    return np.linalg.norm(x, axis=1) - 1.0, np.ones(len(x))


def extracted(function):
    rough, triangles = extract(function, 1.2 * sphere(6000).points, 0.09)
    return relax(rough, triangles, function)[0], triangles


def test_edges_and_corners_of_a_cube_are_met():
    before, triangles = extracted(cube)
    after = untangle([before, sharpen(before, triangles, cube)], triangles)
    assert_valid_mesh(after, triangles, components=1)
    missing = [8.0 - signed_volume(vertices, triangles) for vertices in (before, after)]
    assert abs(missing[1]) < 0.1 * missing[0]
    corners = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3) @ TILTED.T
    apart = [np.linalg.norm(v[:, None] - corners, axis=2).min(axis=0) for v in (before, after)]
    assert (apart[1] <= apart[0] + 1e-12).all()
    assert np.median(apart[1]) < 0.1 * np.median(apart[0])
    assert abs(cube(after)[0]).max() <= abs(cube(before)[0]).max() + 1e-12


def test_a_sphere_stays_as_it_is():
    before, triangles = extracted(distance)
    np.testing.assert_array_equal(sharpen(before, triangles, distance), before)


def test_closings_stay_as_they_are():
    before, triangles = extracted(cube)
    after = sharpen(before, triangles, lambda x: (cube(x)[0], np.zeros(len(x))))
    np.testing.assert_array_equal(after, before)


def test_planes_touch_the_zero_set():
    rng = np.random.default_rng(0)
    x = sphere(200).points * rng.uniform(0.98, 1.02, (200, 1))
    feet, normals, valid = touching_planes(x, np.full(200, 0.01), distance)
    assert valid.all()
    np.testing.assert_allclose(np.linalg.norm(feet, axis=1), 1.0, atol=1e-3)
    np.testing.assert_allclose(normals, feet, atol=5e-3)
    steep = touching_planes(
        x, np.full(200, 0.01), lambda x: (10.0 * distance(x)[0], distance(x)[1])
    )
    assert not steep[2].any()
