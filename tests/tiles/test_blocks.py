"""Blocks of an absolute lattice: whichever tile asks, the same bits; their meshes fit together."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest
from mesh_checks import assert_valid_mesh
from shapes import torus

from o3d_sofnn._kernels import nearest_triangles
from o3d_sofnn.algorithm1 import infer, learn_rules
from o3d_sofnn.algorithm2 import implicit_function
from o3d_sofnn.meshing.isosurface import extraction
from o3d_sofnn.options import Options
from o3d_sofnn.progress import Clock
from o3d_sofnn.tiles.blocks import Blocks, Run
from o3d_sofnn.tiles.dipoles import Coarse, dipoles_of
from o3d_sofnn.tiles.extraction import extract
from o3d_sofnn.tiles.lattice import BLOCK, GATHERED, HALO, Box, Lattice
from o3d_sofnn.tiles.learning import make_patch


@functools.cache
def scene():
    """A torus, the figures of its run, its patch and its dipoles."""
    points, options, clock = torus(12000).noisy(0.002).points, Options(), Clock(None)
    learned = learn_rules(points, options, clock)
    _, facing, residual = infer(learned, options, clock)
    function = implicit_function(learned, facing, residual, options, clock)
    field = function.implicit
    patch = make_patch(
        (field.rules, field.surfaces),
        (function.on_surface, field.normals),
        function.spacing,
        function.on_solid,
    )
    lattice = Lattice(function.size / 8.0, 3)
    places = patch.samples.places
    wall = 8.0 * function.size
    field = function.implicit
    low, high = places.min(axis=0) - wall, places.max(axis=0) + wall
    run = Run(lattice, field.far.level, field.noisiness, low, high)
    dipoles = dipoles_of(lattice, places, patch.samples.areas, patch.samples.normals)
    return function, run, patch, dipoles


def all_of(run):
    """A box of whole blocks that holds everything."""
    low, high = (run.lattice.cells(x[None])[0] // BLOCK * BLOCK for x in (run.low, run.high))
    return Box(low, high + BLOCK)


def tiles_of(run, count):
    """Tiles of about the same number of blocks."""
    box = all_of(run)
    cuts = [
        np.unique(np.rint(np.linspace(a, b, count + 1) / BLOCK).astype(int)) * BLOCK
        for a, b in zip(box.low, box.high, strict=True)
    ]
    spans = [list(itertools.pairwise(cut)) for cut in cuts]
    for x in spans[0]:
        for y in spans[1]:
            for z in [(box.low[2], box.high[2])]:
                yield Box(*np.array([x, y, z]).T)


def meshed(run, own, patch, dipoles):
    """Mesh a tile from what it would gather."""
    size, rim = run.lattice.size, own.grown(GATHERED)
    near = patch.within(rim.low * size, rim.high * size)
    return extract(run, own, near, Blocks(run, near, dipoles.seen_from(own.grown(BLOCK))))


def joined(meshes):
    """Own triangles of all tiles, with vertices that have the same bits made one."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    triangles = [m.triangles[: m.n_own] + start for m, start in zip(meshes, starts, strict=False)]
    everything = np.concatenate([mesh.vertices for mesh in meshes])
    triangles = np.concatenate(triangles)
    vertices, row = np.unique(everything[triangles.ravel()], axis=0, return_inverse=True)
    return vertices, row.reshape(-1, 3).astype(np.int32)


@pytest.mark.parametrize("count", [2, 4])
def test_tiles_join_into_the_mesh_of_all_bit_for_bit(count):
    _, run, patch, dipoles = scene()
    whole = extract(run, all_of(run), patch, Blocks(run, patch, dipoles))
    assert whole.n_own == len(whole.triangles)
    parts = [meshed(run, own, patch, dipoles) for own in tiles_of(run, count)]
    assert all(part.n_own < 0.5 * whole.n_own for part in parts)
    vertices, triangles = joined(parts)
    assert_valid_mesh(vertices, triangles, components=1, apart=False)
    assert len(triangles) == whole.n_own
    np.testing.assert_array_equal(vertices, np.unique(whole.vertices, axis=0))


def test_neighbors_have_the_same_seams_in_the_same_order():
    _, run, patch, dipoles = scene()
    left, right = list(tiles_of(run, 2))[:2]
    one, two = (meshed(run, own, patch, dipoles) for own in (left, right))
    one, two = (mesh.vertices[mesh.seam] for mesh in (one, two))
    both = {x.tobytes() for x in one} & {x.tobytes() for x in two}
    assert len(both) > 50
    shared = [[x for x in part if x.tobytes() in both] for part in (one, two)]
    np.testing.assert_array_equal(*shared)


def test_it_is_the_mesh_of_one_field():
    function, run, patch, dipoles = scene()
    whole = extract(run, all_of(run), patch, Blocks(run, patch, dipoles))
    other = extraction.extract(
        function.implicit, function.on_surface, function.finest, function.levels
    )
    distance = np.asarray(nearest_triangles(*other, whole.vertices, 1)[0])
    # Triangles differ, as the cubes of the lattice begin elsewhere.
    assert distance.mean() < 0.02 * function.size
    assert np.quantile(distance, 0.99) < 0.15 * function.size


def test_a_block_depends_on_what_is_near_and_on_dipoles_alone():
    """Far samples may move within their cells, as long as the dipoles stay."""
    _, run, patch, dipoles = scene()
    middle = run.lattice.cells(patch.samples.places[:1])[0]
    block = middle // BLOCK
    box = Box(block * BLOCK, (block + 1) * BLOCK)
    rim, size = box.grown(HALO), run.lattice.size
    near = patch.within(rim.low * size, rim.high * size)
    assert len(near.samples.places) < 0.7 * len(patch.samples.places)
    cells = np.random.default_rng(0).integers(0, BLOCK // 8, (500, 3)) * 8 + box.low
    middles, edges = 2 * cells + 8, np.full(500, 8)
    all_at_once = Blocks(run, patch, dipoles)(middles, edges)
    one_by_one = Blocks(run, near, dipoles.seen_from(box))
    for i in range(0, 500, 50):
        rows = slice(i, i + 50)
        for got, expected in zip(one_by_one(middles[rows], edges[rows]), all_at_once, strict=True):
            np.testing.assert_array_equal(got, expected[rows])


def test_dipoles_of_all_levels_have_the_moments_of_all_samples():
    _, run, patch, dipoles = scene()
    samples = patch.samples
    moment = (samples.areas[:, None] * samples.normals).sum(axis=0)
    for level in range(int(dipoles.level.max()) + 1):
        rows = dipoles.level == level
        assert dipoles.areas[rows].sum() == pytest.approx(samples.areas.sum())
        np.testing.assert_allclose(dipoles.moments[rows].sum(axis=0), moment, atol=1e-9)
    box = Box(run.lattice.cells(run.low[None])[0] - 4096, run.lattice.cells(run.low[None])[0])
    seen = dipoles.far_from(Box(box.low // BLOCK * BLOCK, box.low // BLOCK * BLOCK + BLOCK))
    assert len(seen) < 0.1 * len(samples.places)
    assert seen.areas.sum() == pytest.approx(samples.areas.sum())


def test_coarse_dipoles_suffice_where_they_say_so():
    _, run, _, dipoles = scene()
    coarse = Coarse.of(0, dipoles)
    assert 0 < len(coarse.dipoles) < 0.5 * len(dipoles)
    start, seen = all_of(run).low, []
    for step in (0, 2 * BLOCK, 20 * BLOCK):
        box = Box(start - step - BLOCK, start - step)
        seen.append(coarse.suffices(box))
        if seen[-1]:
            for name, values in vars(dipoles.far_from(box)).items():
                np.testing.assert_array_equal(getattr(coarse.dipoles.far_from(box), name), values)
    assert seen[0] is False
    assert seen[-1] is True
