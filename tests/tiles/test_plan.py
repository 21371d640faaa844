"""Plans: tiles of at most so many points, on a lattice that the bounding box does not move."""

from __future__ import annotations

import numpy as np
import pytest

from o3d_sofnn.tiles.lattice import BLOCK, Lattice
from o3d_sofnn.tiles.plan import Counts, Finder, earlier, lattice_of, plan

POINTS = np.random.default_rng(0).normal(size=(20_000, 3)) * [3.0, 2.0, 0.01] + [5e5, 4e6, 100.0]


def counts():
    return Counts.of(np.array_split(POINTS, 7), POINTS.min(axis=0), POINTS.max(axis=0))


def test_every_point_is_in_one_tile_of_at_most_so_many():
    found = counts()
    tiles = plan(found, 1500)
    x = (POINTS - found.origin) / found.edge
    inside = np.stack([tile.holds(x) for tile in tiles])
    assert (inside.sum(axis=0) == 1).all()
    np.testing.assert_array_equal(inside.sum(axis=1), [tile.count for tile in tiles])
    assert max(tile.count for tile in tiles) <= 1500
    np.testing.assert_array_equal(Finder(tiles).tiles(x), inside.argmax(axis=0))
    assert [tile.number for tile in tiles] == list(range(len(tiles)))


def test_rims_follow_the_spacing():
    xy = np.random.default_rng(0).uniform(size=(40_000, 2))
    points = np.column_stack([xy, 0.0 * xy[:, 0]])
    points = points[(points[:, 0] < 0.5) | (np.arange(len(points)) % 16 == 0)]
    found = Counts.of([points], points.min(axis=0), points.max(axis=0))
    tiles = plan(found, 4000)
    for low, spacing in ((0.1, 1.0 / 200.0), (0.8, 4.0 / 200.0)):
        at = (np.array([low, 0.4, 0.0]) - found.origin) / found.edge
        rim = next(tile.rim for tile in tiles if tile.holds(at[None])[0]) * found.edge
        assert rim == pytest.approx(32.0 * spacing, rel=0.3)


def test_the_lattice_depends_on_the_size_of_the_box_alone():
    low, high = np.array([1.0, 2.0, 3.0]), np.array([6.0, 4.0, 3.5])
    edge, origin = lattice_of(low, high)
    for step in (0.3, 1.7):
        same, other = lattice_of(low + step, high + step)
        assert same == edge
        np.testing.assert_array_equal((other - origin) % edge, 0.0)


@pytest.mark.parametrize("size", [0.5, 3.0, 40.0])
def test_cubes_of_tiles_fill_space_without_overlap(size):
    tiles, lattice = plan(counts(), 2000), Lattice(size, 3)
    boxes = [tile.meshed(lattice) for tile in tiles]
    low = min(int(box.low.min()) for box in boxes)
    high = max(int(box.high.max()) for box in boxes)
    corners = np.random.default_rng(1).integers(low // BLOCK, high // BLOCK, (3000, 3)) * BLOCK
    assert (np.stack([box.holds(corners) for box in boxes]).sum(axis=0) == 1).all()
    for number, touched in enumerate(earlier(tiles, lattice)):
        assert all(other < number for other in touched)
