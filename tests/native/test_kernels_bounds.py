"""Kernels with odd input: finite numbers give finite numbers, nothing is read out of bounds."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

import numpy as np
import pytest
from kernel_data import mesh, places_near, random_rules, random_terms, unit_data, view, with_trust
from shapes import sphere, torus

from o3d_sofnn import _kernels, reference
from o3d_sofnn.meshing.marching_cubes import EDGE_ENDS, NUDGES, both_tables
from o3d_sofnn.reference.sampling.local_fit import Wanted


def lattice(*shape):
    return np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3) * 1.0


# --- finite in, finite out


@pytest.mark.parametrize("turn", [np.eye(3), np.linalg.qr(np.arange(9.0).reshape(3, 3) % 5)[0]])
def test_frames_where_the_narrow_tangent_is_the_normal(turn):
    """All directions of a lattice are alike: the plane of a fit may lie across any tangent."""
    points = np.ascontiguousarray(lattice(5, 5, 5) @ turn)
    centers = points[[0, 31, 62, 124]]
    sizes, robust, stretch = np.full(4, 60), np.full(4, 0.3), np.full(4, 1.7)
    tree = _kernels.KdTree(points, 1)
    for axis in turn:
        normals, sides = np.tile(axis, (125, 1)), np.tile(axis, (4, 1))
        for across in turn:
            options = sides, np.tile(across, (4, 1)), stretch
            found = _kernels.fit_quadrics(
                tree, points, centers, sizes, robust, 3, normals, *options, 1
            )
            wanted = Wanted(sizes, robust, *options)
            expected = reference.fit_quadrics(points, centers, wanted, 3, normals)
            frames = np.asarray(found[0])
            np.testing.assert_allclose(
                frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (4, 1, 1)), atol=1e-12
            )
            assert all(np.isfinite(array).all() for array in found)
            # Radius and support do not depend on which of some equal axes is taken.
            for array, other in zip(found[3:], expected[3:], strict=True):
                np.testing.assert_allclose(array, other, rtol=1e-9)


def test_a_fit_without_any_weight_is_a_plane():
    """All neighbours lie on the narrow axis, beyond the ellipse."""
    points = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    up, across = np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]])
    size, robust, normals = np.array([2]), np.array([0.1]), np.tile(up, (2, 1))
    options = up, across, np.array([1.9])
    tree, center = _kernels.KdTree(points, 1), np.zeros((1, 3))
    found = _kernels.fit_quadrics(tree, points, center, size, robust, 3, normals, *options, 1)
    expected = reference.fit_quadrics(points, center, Wanted(size, robust, *options), 3, normals)
    for array, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(array, other, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(found[1], 0.0)


def odd_rules(kind):
    rules = random_rules()
    if kind == "one place":
        return rules._replace(centers=np.zeros_like(rules.centers))
    if kind == "no extent":
        return rules._replace(radius=np.where(np.arange(300) % 2, rules.radius, 1e-300))
    if kind == "no tolerance":
        return rules._replace(tolerance=np.zeros(300))
    if kind == "short frames":
        return rules._replace(frames=0.3 * rules.frames)
    if kind == "skew frames":
        frames = rules.frames.copy()
        frames[:, 0] = frames[:, 2]
        return rules._replace(frames=frames)
    if kind == "steep":
        return rules._replace(coefficients=1e12 * rules.coefficients)
    if kind == "no quality":
        return rules._replace(quality=np.zeros(300))
    assert kind == "far places"
    return rules


ODD = [
    *("one place", "no extent", "no tolerance", "short frames", "skew frames", "steep"),
    *("no quality", "far places"),
]


@pytest.mark.parametrize("kind", ODD)
def test_odd_rules_say_something_finite(kind):
    rules = odd_rules(kind)
    terms = random_terms()
    x = places_near(rules) * (1e15 if kind == "far places" else 1.0)
    for trusted in (rules, with_trust(rules)):
        normals, agreement, residual = _kernels.infer_normals(view(trusted), x, None, 12, 1)
        assert np.isfinite(agreement).all()
        assert np.isfinite(residual).all()
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    assert all(np.isfinite(a).all() for a in _kernels.consequent_errors(view(rules), x, 12, 1))
    for k in (1, 3, 16):
        assert np.isfinite(_kernels.evaluate_field(view(rules), *terms, x, k, 1)).all()


@pytest.mark.parametrize("kind", ["no tolerance", "short frames", "no quality"])
def test_odd_rules_are_those_of_the_twins(kind):
    rules, terms = odd_rules(kind), random_terms()
    x = places_near(rules)[::9]
    found = np.asarray(_kernels.evaluate_field(view(rules), *terms, x, 5, 1))
    expected = reference.evaluate_field(rules, *terms, x, 5)
    close = np.isclose(found, expected, rtol=1e-6, atol=1e-9)
    assert close.mean() > 0.97, close.mean()  # equal memberships may tie in another order
    infer = _kernels.infer_normals(view(rules), x, None, 5, 1)
    for array, other in zip(infer, reference.infer_normals(rules, x, None, 5), strict=True):
        assert np.isclose(array, other, rtol=1e-6, atol=1e-9).mean() > 0.97


@pytest.mark.parametrize("radius", [1e-300, 1e-12, 1e12])
def test_units_of_any_size_are_finite(radius):
    points, normals, rules, *rest = unit_data(*torus(900))
    rules = rules._replace(radius=np.full(len(rules.centers), radius))
    tree = _kernels.KdTree(points, 1)
    found = _kernels.reconstruct_units(tree, points, normals, view(rules), *rest, 1)
    assert all(np.isfinite(array).all() for array in found)


@pytest.mark.parametrize("spot", [0.0, 1e-20, 1e-12, 1e-8])
def test_winding_numbers_of_a_dense_spot(spot):
    """Within single precision all of it is one place, whatever the smoothing width."""
    rng = np.random.default_rng(0)
    dense = [0.3, 0.2, 0.1] + spot * rng.normal(size=(500, 3))
    points, normals = sphere(500)
    x = np.concatenate([dense, points])
    mu = np.concatenate([rng.normal(size=(500, 3)), normals])
    charge, width = rng.normal(size=1000), np.full(1000, 1e-30)
    tree = _kernels.WindingTree(x, np.ones(1000))
    # What the iteration of the sides does: the answer to one sum is what the next one adds up.
    winding = np.asarray(tree.winding(mu, x, width, 0.6, 1))
    assert np.isfinite(winding).all()
    downhill = np.asarray(tree.adjoint_at(charge, tree.lists(x, 0.6, 1), width, 1))
    for vectors in (downhill, np.asarray(tree.gradient(mu, x, width, 0.6, 1)[1])):
        assert np.isfinite(vectors).all()
        assert np.isfinite(tree.winding(vectors, x, width, 0.6, 1)).all()
    if spot == 0.0:
        expected = reference.evaluate_winding(x[500:], normals, None, x[500:], width[500:])[0]
        alone = _kernels.WindingTree(points, np.ones(500))
        found = alone.winding(normals, points, width[500:], 1e-6, 1)
        np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3 * np.abs(expected).max())


def test_the_crossing_of_values_that_are_no_numbers_is_on_the_edge():
    nodes = lattice(2, 2, 2)[:, ::-1].copy()
    values = np.array([-1.0, *[np.nan] * 7])
    args = values, nodes, np.arange(8, dtype=np.int32)[None], *both_tables(), EDGE_ENDS, NUDGES
    vertices, triangles, *_ = map(np.asarray, _kernels.marching_cubes(*args))
    np.testing.assert_allclose(np.sort(vertices.sum(axis=1)), NUDGES[0])
    assert len(triangles) == 1
    np.testing.assert_allclose(reference.marching_cubes(*args)[0], vertices)


# --- lengths and indices that do not fit


def wrong_calls():
    points, normals = torus(200)
    tree, one = _kernels.KdTree(points, 1), np.ones(200)
    few, ints = points[:5], np.full(5, 8)
    rules = random_rules(200)
    rule_view, terms = view(rules), random_terms(200)
    units = np.full(200, 20), np.full(200, 10), np.full(200, 0.1)
    vertices, triangles, moved = mesh(0)
    beyond, below = triangles.copy(), triangles.copy()
    beyond[7, 2], below[0, 0] = len(vertices), -1
    cubes = np.arange(8, dtype=np.int32)[None]
    cube = np.zeros(8), np.zeros((8, 3))
    tables = *both_tables(), EDGE_ENDS, NUDGES
    bad_table = both_tables()[0].copy()
    bad_table[0, 1, 0] = 16
    winding = _kernels.WindingTree(points, one)
    lists = winding.lists(few, 0.6, 1)
    other = _kernels.WindingTree(few, np.ones(5))
    origin, levels = np.full(3, -20.0), np.zeros(5, np.int64)
    fit = tree, points, few, ints, np.zeros(5), 1
    sided = normals, few, None, np.ones(5), 1
    half_edges = np.array([0], np.int32)
    yield "k", lambda: tree.query(few, 0, 1.0, 1)
    yield "k", lambda: tree.query(few, 2**31, 1.0, 1)
    yield "distance", lambda: tree.crowded(few, 1, one, 1)
    yield "points", lambda: _kernels.fit_scales(tree, few, few, ints[:1], 1)
    yield "scales", lambda: _kernels.fit_scales(tree, points, few, np.array([8, 7]), 1)
    yield "scales", lambda: _kernels.fit_scales(tree, points, few, np.array([0]), 1)
    yield "points, normals", lambda: _kernels.fit_quadrics(tree, few, *fit[2:], *sided)
    yield "points, normals", lambda: _kernels.fit_quadrics(*fit, few, *sided[1:])
    yield "sides", lambda: _kernels.fit_quadrics(*fit, normals, None, *sided[2:])
    yield "sides", lambda: _kernels.fit_quadrics(*fit, normals, normals, *sided[2:])
    yield "across", lambda: _kernels.fit_quadrics(*fit, None, None, few, *sided[3:])
    yield "stretch", lambda: _kernels.fit_quadrics(*fit, *sided[:3], one, 1)
    yield "n_neighbors", lambda: _kernels.fit_quadrics(*fit[:3], -ints, *fit[4:], *sided)
    yield "radius", lambda: view(rules._replace(radius=one[:9]))
    yield "gates", lambda: view(with_trust(rules)._replace(gates=np.zeros((9, 3, 2))))
    yield "sides", lambda: _kernels.infer_normals(rule_view, points, few, 3, 1)
    yield "k", lambda: _kernels.infer_normals(rule_view, points, None, 0, 1)
    yield "k", lambda: _kernels.consequent_errors(rule_view, points, 0, 1)
    yield "terms", lambda: _kernels.evaluate_field(rule_view, terms[0], terms[1][:9], few, 3, 1)
    yield "terms", lambda: _kernels.evaluate_field(rule_view, terms[0], terms[1] + 9, few, 3, 1)
    yield "k", lambda: _kernels.evaluate_field(rule_view, *terms, few, 0, 1)
    unit = tree, points, normals, rule_view
    yield "normals", lambda: _kernels.reconstruct_units(*unit[:2], few, rule_view, *units, 1)
    yield "n_own", lambda: _kernels.reconstruct_units(*unit, units[0], ints, units[2], 1)
    yield "n_own", lambda: _kernels.reconstruct_units(*unit, units[1], units[0], units[2], 1)
    yield "n_own", lambda: _kernels.reconstruct_units(*unit, units[0], 0 * units[1], units[2], 1)
    yield "offsets", lambda: _kernels.typical_data(points, np.array([0, 201]), ints[:1], 1, 0.0, 1)
    yield "offsets", lambda: _kernels.typical_data(points, np.array([5, 5]), ints[:1], 1, 0.0, 1)
    yield "offsets", lambda: _kernels.typical_data(points, ints[:0], ints[:0], 1, 0.0, 1)
    yield "n_clusters", lambda: _kernels.typical_data(points, np.array([0, 5]), ints, 1, 0.0, 1)
    yield "n_clusters", lambda: _kernels.typical_data(points, np.array([0, 5]), ints[:1], 1, 0.0, 1)
    yield "first", lambda: _kernels.divide_cells(normals, np.array([0, 199]), 1)
    yield "first", lambda: _kernels.divide_cells(normals, np.array([0, 0, 200]), 1)
    yield "area", lambda: _kernels.WindingTree(points, np.ones(5))
    yield "width", lambda: winding.winding(normals, few, one, 0.6, 1)
    yield "mu", lambda: winding.winding(few, few, np.ones(5), 0.6, 1)
    yield "mu", lambda: winding.adjoint_at(np.ones(5), lists, np.ones(5), 1)
    yield "lists", lambda: other.winding_at(few, lists, np.ones(5), 1)
    yield "lists", lambda: winding.gradient_at(normals, lists, one, 1)
    yield "levels", lambda: _kernels.DualWalk(few, origin, 1.0, levels + 3, 2, 1)
    yield "levels", lambda: _kernels.DualWalk(few, origin, 1.0, levels[:2], 2, 1)
    yield "levels", lambda: _kernels.DualWalk(few, origin, 1.0, levels, 40, 1)
    yield "size", lambda: _kernels.DualWalk(few, origin, 1e-7, levels, 2, 1)
    yield "size", lambda: _kernels.DualWalk(few + np.nan, origin, 1.0, levels, 2, 1)
    walk = _kernels.DualWalk(few, origin, 1.0, levels, 2, 1)
    yield "inside", lambda: walk.advance(np.zeros(10**4, bool))
    yield "cubes", lambda: _kernels.marching_cubes(*cube, cubes + 1, *tables)
    yield "values", lambda: _kernels.marching_cubes(np.zeros(7), cube[1], cubes, *tables)
    yield "tables", lambda: _kernels.marching_cubes(*cube, cubes, bad_table, *tables[1:])
    for wrong in (beyond, below):
        yield "triangles", lambda wrong=wrong: _kernels.vertex_normals(vertices, wrong)
        yield "triangles", lambda wrong=wrong: _kernels.surroundings(vertices, wrong)
        yield "triangles", lambda wrong=wrong: _kernels.bent_vertices(vertices, wrong, moved, 0.5)
        yield "triangles", lambda wrong=wrong: _kernels.undo_turns(vertices, moved, wrong, 0.5)
        yield "triangles", lambda wrong=wrong: _kernels.label_pieces(wrong, len(vertices))
        yield "triangles", lambda wrong=wrong: _kernels.handle_edges(vertices, wrong)
        yield "triangles", lambda wrong=wrong: _kernels.decimate(vertices, wrong, 9, 1)
        yield "triangles", lambda wrong=wrong: _kernels.nearest_triangles(few, wrong, few, 1)
        suspect = np.ones(len(wrong), bool)
        yield "triangles", lambda w=wrong, s=suspect: _kernels.intersecting_pairs(vertices, w, s, 1)
    yield "normals", lambda: _kernels.bent_vertices(vertices, triangles, few, 0.5)
    yield "after", lambda: _kernels.undo_turns(vertices, few, triangles, 0.5)
    yield "suspect", lambda: _kernels.intersecting_pairs(vertices, triangles, suspect[1:], 1)
    yield "closed", lambda: _kernels.handle_edges(vertices, triangles[1:])
    yield "closed", lambda: _kernels.open_handles(vertices, triangles[1:], half_edges, one[:1])
    yield "edges", lambda: _kernels.open_handles(vertices, triangles, half_edges - 1, one[:1])
    yield "edges", lambda: _kernels.open_handles(vertices, triangles, half_edges, one)


def test_what_does_not_fit_is_an_error_that_names_the_argument():
    calls = list(wrong_calls())
    for name, call in calls:
        with pytest.raises(ValueError, match=name):
            call()
    assert len(calls) > 60


# --- no numbers in


NOT_NUMBERS = """
import numpy as np
from kernel_data import mesh, random_rules, random_terms, view
from shapes import torus
from o3d_sofnn import _kernels
points, normals = torus(600)
for bad in (np.nan, np.inf, -np.inf, 1e308):
    for rows in (slice(None), slice(0, 600, 7)):
        x = points.copy()
        x[rows] = bad
        _kernels.sort_morton(x, 1)
        for data in (points, x):
            tree = _kernels.KdTree(data, 1)
            for k in (1, 20, 300):
                tree.query(x, k, np.inf, 1)
            tree.crowded(x, 3, np.full(600, 0.1), 1)
            _kernels.fit_scales(tree, data, x, np.array([8, 70]), 1)
            wide = np.full(600, 1.5)
            _kernels.fit_quadrics(tree, data, x, np.full(600, 30), wide, 3, x, x, x, wide, 1)
            winding = _kernels.WindingTree(data, np.ones(600))
            winding.gradient(x, x, np.full(600, 0.1), 0.6, 1)
        rules = random_rules(600)
        huge = np.full((600, 6), bad)
        for odd in (rules, rules._replace(centers=x), rules._replace(coefficients=huge)):
            _kernels.infer_normals(view(odd), x, x, 12, 1)
            _kernels.evaluate_field(view(odd), *random_terms(600), x, 12, 1)
    vertices, triangles, moved = mesh(0)
    for rows in (slice(None), slice(0, None, 50)):
        odd = vertices.copy()
        odd[rows] = bad
        _kernels.surroundings(odd, triangles)
        _kernels.intersecting_pairs(odd, triangles[:300], np.ones(300, bool), 1)
        _kernels.decimate(odd, triangles[:300], 100, 1)
        _kernels.nearest_triangles(odd, triangles, vertices[:20], 1)
        _kernels.nearest_triangles(vertices, triangles, odd[:20], 1)
        _kernels.undo_turns(odd, moved, triangles, 0.5)
        _kernels.undo_turns(vertices, odd, triangles, 0.5)
        edges = np.asarray(_kernels.handle_edges(odd, triangles))
        _kernels.open_handles(odd, triangles, edges, np.full(len(edges), 10.0))
"""


def test_what_is_no_number_does_not_end_the_process():
    path = ":".join(entry for entry in sys.path if entry)
    done = subprocess.run(
        [sys.executable, "-c", NOT_NUMBERS],
        env={**os.environ, "PYTHONPATH": path, "PYTHONWARNINGS": "ignore"},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        cwd=tempfile.gettempdir(),  # where no sources hide the installed package
    )
    assert done.returncode == 0, done.stderr[-2000:]
