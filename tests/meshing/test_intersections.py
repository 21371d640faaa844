"""Triangles that meet: what the kernel, its twin, MeshLab and Open3D say."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_checks import meshlab_intersections
from shapes import sphere

from o3d_sofnn import _kernels, reference
from o3d_sofnn.meshing.isosurface.extraction import extract


def pairs(vertices, triangles, suspect=None, n_threads=1):
    vertices = np.ascontiguousarray(vertices, np.float64)
    triangles = np.ascontiguousarray(triangles, np.int32)
    suspect = np.ones(len(triangles), bool) if suspect is None else suspect
    return np.asarray(_kernels.intersecting_pairs(vertices, triangles, suspect, n_threads))


def soup(kind):
    """Random triangles over few vertices: many have corners in common."""
    rng = np.random.default_rng(["anywhere", "flat", "lattice", "nearly flat"].index(kind))
    vertices = rng.uniform(0.0, 1.0, (50, 3))
    if kind == "lattice":
        vertices = np.round(4.0 * vertices) / 4.0
    vertices[:, 2] *= {"flat": 0.0, "nearly flat": 1e-3}.get(kind, 1.0)
    triangles = np.array([rng.choice(50, 3, replace=False) for _ in range(120)], np.int32)
    return vertices, triangles, rng.random(120) < 0.5


@pytest.mark.parametrize("kind", ["anywhere", "flat", "lattice", "nearly flat"])
def test_kernel_and_twin(kind):
    expected = reference.intersecting_pairs(*soup(kind))
    assert len(expected) > 500
    for n_threads in (1, 3):
        np.testing.assert_array_equal(pairs(*soup(kind), n_threads), expected)


def rough_ball(noise):
    """A ball whose vertices have moved so far that some of its triangles cut others."""
    vertices, triangles = extract(
        lambda x: (np.linalg.norm(x, axis=1) - 1.0, np.ones(len(x))), sphere(3000).points, 0.12
    )
    return vertices + np.random.default_rng(0).normal(0.0, noise, vertices.shape), triangles


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.06])
def test_meshlab_and_open3d_find_the_same(noise):
    import open3d

    vertices, triangles = rough_ball(noise)
    found = pairs(vertices, triangles)
    assert (len(found) > 0) == (noise > 0.0)
    ours, theirs = np.unique(found), meshlab_intersections(vertices, triangles)
    assert np.isin(theirs, ours).all()
    assert len(ours) <= 1.02 * len(theirs), "more than those that almost touch"
    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(triangles)
    )
    # Open3D looks at triangles without a common corner only.
    common = (triangles[found[:, 0], :, None] == triangles[found[:, 1], None]).any(axis=(1, 2))
    strangers = {(i, j) for i, j in found[~common].tolist()}
    theirs = {(min(i, j), max(i, j)) for i, j in np.asarray(mesh.get_self_intersecting_triangles())}
    assert theirs <= strangers
    assert len(strangers) <= 1.02 * len(theirs)


@pytest.mark.parametrize("scale", [2.0**-300, 2.0**-40, 2.0**40, 2.0**300])
def test_any_unit_gives_the_same(scale):
    vertices, triangles = rough_ball(0.04)
    np.testing.assert_array_equal(pairs(scale * vertices, triangles), pairs(vertices, triangles))


A, B, C = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
STRANGERS = {
    "apart": ([[2.0, 0.0, 0.0], [3.0, 0.0, 0.0], [2.0, 1.0, 0.0]], False),
    "parallel": ([[0.0, 0.0, 1e-3], [1.0, 0.0, 1e-3], [0.0, 1.0, 1e-3]], False),
    "nearer than rounding tells": ([[0.0, 0.0, 1e-6], [1.0, 0.0, 1e-6], [0.0, 1.0, 1e-6]], True),
    "covered": ([[0.1, 0.1, 0.0], [0.2, 0.1, 0.0], [0.1, 0.2, 0.0]], True),
    "beside in a plane": ([[1.1, 0.1, 0.0], [1.1, 1.0, 0.0], [0.2, 1.0, 0.0]], False),
    "edge through": ([[0.2, 0.2, -1.0], [0.2, 0.2, 1.0], [2.0, 2.0, 0.0]], True),
    "corner on it": ([[0.2, 0.2, 0.0], [0.2, 0.2, 1.0], [0.4, 0.2, 1.0]], True),
    "past a corner": ([[1.2, 0.0, -1.0], [1.2, 0.0, 1.0], [2.0, 1.0, 0.0]], False),
    "edges that cross": ([[0.5, -1.0, 0.0], [0.5, 1.0, 0.0], [0.5, 0.0, 1.0]], True),
}


@pytest.mark.parametrize("name", STRANGERS)
def test_without_a_common_corner(name):
    other, meet = STRANGERS[name]
    assert len(pairs([A, B, C, *other], [[0, 1, 2], [3, 4, 5]])) == meet


CORNERS = {
    "a fan in a plane": ([[-1.0, 0.1, 0.0], [-1.0, -1.0, 0.0]], False),
    "edges on one line": ([[-1.0, 0.0, 0.0], [-1.0, -1.0, 0.0]], False),
    "both edges on lines": ([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], False),
    "covered": ([[0.3, 0.2, 0.0], [0.2, 0.3, 0.0]], True),
    "one edge within": ([[0.3, 0.3, 0.0], [1.0, -1.0, 0.0]], True),
    "one edge through": ([[0.5, 0.5, 0.5], [0.5, 0.5, -0.5]], True),
    "one edge along another": ([[2.0, 0.0, 0.0], [1.0, 0.0, 1.0]], True),
    "folded up": ([[0.2, 0.3, 0.1], [0.3, 0.2, 0.1]], False),
    "upright beside": ([[0.5, -0.1, 0.5], [0.5, -0.1, -0.5]], False),
}


@pytest.mark.parametrize("name", CORNERS)
def test_with_a_common_corner(name):
    other, meet = CORNERS[name]
    assert len(pairs([A, B, C, *other], [[0, 1, 2], [0, 3, 4]])) == meet


@pytest.mark.parametrize(("x", "meet"), [((0.5, -1.0, 0.0), False), ((0.5, 0.5, 0.1), False)])
def test_with_a_common_edge(x, meet):
    assert len(pairs([A, B, C, x], [[0, 1, 2], [1, 0, 3]])) == meet
    folded = [0.3, 0.2, 0.0]
    assert len(pairs([A, B, C, folded], [[0, 1, 2], [1, 0, 3]])) == 1


def test_only_suspects_are_asked_for():
    vertices, triangles = rough_ball(0.04)
    everything = pairs(vertices, triangles)
    suspect = np.zeros(len(triangles), bool)
    assert pairs(vertices, triangles, suspect).shape == (0, 2)
    suspect[everything[0, 0]] = True
    expected = everything[(everything == everything[0, 0]).any(axis=1)]
    np.testing.assert_array_equal(pairs(vertices, triangles, suspect), expected)


@pytest.mark.parametrize("count", [0, 1])
def test_no_or_one_triangle(count):
    assert pairs([A, B, C], np.array([[0, 1, 2]])[:count]).shape == (0, 2)
