"""Kernels with arguments that do not fit, and with what is no number."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

import numpy as np
import pytest
from kernel_data import mesh, random_rules, random_terms, view, with_trust
from shapes import torus

from o3d_sofnn import _kernels
from o3d_sofnn.meshing.isosurface.marching_cubes import EDGE_ENDS, NUDGES, both_tables


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
    lists = winding.lists(few, 0.6)
    other = _kernels.WindingTree(few, np.ones(5))
    origin, levels = np.full(3, -20.0), np.zeros(5, np.int64)
    fit = tree, points, few, ints, np.zeros(5), 1
    sided = normals, few, None, np.ones(5)
    half_edges = np.array([0], np.int32)
    yield "k", lambda: tree.query(few, 0, 1.0)
    yield "k", lambda: tree.query(few, 2**31, 1.0)
    yield "distance", lambda: tree.crowded(few, 1, one)
    yield "points", lambda: _kernels.fit_scales(tree, few, few, ints[:1])
    yield "scales", lambda: _kernels.fit_scales(tree, points, few, np.array([8, 7]))
    yield "scales", lambda: _kernels.fit_scales(tree, points, few, np.array([0]))
    yield "points, normals", lambda: _kernels.fit_quadrics(tree, few, *fit[2:], *sided)
    yield "points, normals", lambda: _kernels.fit_quadrics(*fit, few, *sided[1:])
    yield "sides", lambda: _kernels.fit_quadrics(*fit, normals, None, *sided[2:])
    yield "sides", lambda: _kernels.fit_quadrics(*fit, normals, normals, *sided[2:])
    yield "across", lambda: _kernels.fit_quadrics(*fit, None, None, few, *sided[3:])
    yield "stretch", lambda: _kernels.fit_quadrics(*fit, *sided[:3], one)
    yield "n_neighbors", lambda: _kernels.fit_quadrics(*fit[:3], -ints, *fit[4:], *sided)
    yield "radius", lambda: view(rules._replace(radius=one[:9]))
    yield "gates", lambda: view(with_trust(rules)._replace(gates=np.zeros((9, 3, 2))))
    yield "sides", lambda: _kernels.infer_normals(rule_view, points, few, 3)
    yield "k", lambda: _kernels.infer_normals(rule_view, points, None, 0)
    yield "k", lambda: _kernels.consequent_errors(rule_view, points, 0)
    yield "terms", lambda: _kernels.evaluate_field(rule_view, terms[0], terms[1][:9], few, 3)
    yield "terms", lambda: _kernels.evaluate_field(rule_view, terms[0], terms[1] + 9, few, 3)
    yield "k", lambda: _kernels.evaluate_field(rule_view, *terms, few, 0)
    unit = tree, points, normals, rule_view
    yield "normals", lambda: _kernels.reconstruct_units(*unit[:2], few, rule_view, *units)
    yield "n_own", lambda: _kernels.reconstruct_units(*unit, units[0], ints, units[2])
    yield "n_own", lambda: _kernels.reconstruct_units(*unit, units[1], units[0], units[2])
    yield "n_own", lambda: _kernels.reconstruct_units(*unit, units[0], 0 * units[1], units[2])
    yield "offsets", lambda: _kernels.typical_data(points, np.array([0, 201]), ints[:1], 1, 0.0, 1)
    yield "offsets", lambda: _kernels.typical_data(points, np.array([5, 5]), ints[:1], 1, 0.0, 1)
    yield "offsets", lambda: _kernels.typical_data(points, ints[:0], ints[:0], 1, 0.0, 1)
    yield "n_clusters", lambda: _kernels.typical_data(points, np.array([0, 5]), ints, 1, 0.0, 1)
    yield "n_clusters", lambda: _kernels.typical_data(points, np.array([0, 5]), ints[:1], 1, 0.0, 1)
    yield "first", lambda: _kernels.divide_cells(normals, np.array([0, 199]), 1)
    yield "first", lambda: _kernels.divide_cells(normals, np.array([0, 0, 200]), 1)
    yield "area", lambda: _kernels.WindingTree(points, np.ones(5))
    yield "width", lambda: winding.winding(normals, few, one, 0.6)
    yield "mu", lambda: winding.winding(few, few, np.ones(5), 0.6)
    yield "mu", lambda: winding.adjoint_at(np.ones(5), lists, np.ones(5))
    yield "lists", lambda: other.winding_at(few, lists, np.ones(5))
    yield "lists", lambda: winding.gradient_at(normals, lists, one)
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
    yield "closed", lambda: _kernels.open_handles(vertices, triangles[1:], half_edges, one[:1], 9)
    yield "edges", lambda: _kernels.open_handles(vertices, triangles, half_edges - 1, one[:1], 9)
    yield "edges", lambda: _kernels.open_handles(vertices, triangles, half_edges, one, 9)
    yield "largest", lambda: _kernels.open_handles(vertices, triangles, half_edges, one[:1], 0)


def test_what_does_not_fit_is_an_error_that_names_the_argument():
    calls = list(wrong_calls())
    for name, call in calls:
        with pytest.raises(ValueError, match=name):
            call()
    assert len(calls) > 60


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
                tree.query(x, k, np.inf)
            tree.crowded(x, 3, np.full(600, 0.1))
            _kernels.fit_scales(tree, data, x, np.array([8, 70]))
            wide = np.full(600, 1.5)
            _kernels.fit_quadrics(tree, data, x, np.full(600, 30), wide, 3, x, x, x, wide)
            winding = _kernels.WindingTree(data, np.ones(600))
            winding.gradient(x, x, np.full(600, 0.1), 0.6)
        rules = random_rules(600)
        huge = np.full((600, 6), bad)
        for odd in (rules, rules._replace(centers=x), rules._replace(coefficients=huge)):
            _kernels.infer_normals(view(odd), x, x, 12)
            _kernels.evaluate_field(view(odd), *random_terms(600), x, 12)
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
        _kernels.open_handles(odd, triangles, edges, np.full(len(edges), 10.0), 10_000)
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
