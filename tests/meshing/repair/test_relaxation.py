"""Triangles that are even, on the surface, and connected as before."""

from __future__ import annotations

import numpy as np
from mesh_checks import assert_valid_mesh
from shapes import sphere, torus

from o3d_sofnn.meshing.isosurface.extraction import extract
from o3d_sofnn.meshing.repair.relaxation import relax, smooth_closings
from o3d_sofnn.pipeline import reconstruct_surface


def distance(x):
    return np.linalg.norm(x, axis=1) - 1.0, np.ones(len(x))


def smallest_angles(vertices, triangles):
    corner = vertices[triangles]
    following = np.roll(corner, -1, axis=1) - corner
    before = np.roll(corner, 1, axis=1) - corner
    cosine = (following * before).sum(axis=2)
    cosine /= np.linalg.norm(following, axis=2) * np.linalg.norm(before, axis=2)
    return np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))).min(axis=1)


def test_a_sphere_gets_even_triangles_and_stays_a_sphere():
    rough, triangles = extract(distance, sphere(4000).points, 0.08)
    vertices, support = relax(rough, triangles, distance)
    assert_valid_mesh(vertices, triangles, components=1)
    assert (support == 1.0).all()
    before, after = smallest_angles(rough, triangles), smallest_angles(vertices, triangles)
    assert (before < 10.0).mean() > 0.05
    assert (after < 10.0).mean() < 0.005
    assert abs(distance(vertices)[0]).max() < 0.5 * abs(distance(rough)[0]).max()


def test_no_triangle_turns_where_the_function_lies():
    rough, triangles = extract(distance, sphere(4000).points, 0.08)
    rng = np.random.default_rng(0)
    vertices, _ = relax(rough, triangles, lambda x: (rng.normal(size=len(x)), np.ones(len(x))))
    assert_valid_mesh(vertices, triangles, components=1)
    facing = [
        np.cross(v[triangles[:, 1]] - v[triangles[:, 0]], v[triangles[:, 2]] - v[triangles[:, 0]])
        for v in (rough, vertices)
    ]
    assert ((facing[0] * facing[1]).sum(axis=1) > 0.0).all()


def test_reconstructed_triangles_are_even():
    surface = reconstruct_surface(torus(4000).points)
    assert_valid_mesh(surface.vertices, surface.triangles, components=1)
    assert (smallest_angles(surface.vertices, surface.triangles) < 10.0).mean() < 0.01


def test_closings_become_smooth_and_the_data_stays():
    smooth, triangles = extract(distance, sphere(4000).points, 0.08)
    rng = np.random.default_rng(0)
    closing = smooth[:, 2] > 0.8
    rough = smooth + 0.02 * rng.normal(size=smooth.shape) * closing[:, None]
    support = np.where(closing, 0.0, 1.0)
    vertices = smooth_closings(rough, triangles, support)
    assert_valid_mesh(vertices, triangles, components=1)
    np.testing.assert_array_equal(vertices[~closing], rough[~closing])
    before, after = (abs(distance(v[closing])[0]).mean() for v in (rough, vertices))
    assert after < 0.6 * before
