"""Pictures: what is nearer hides what is farther, and files are valid PNG."""

from __future__ import annotations

import io

import numpy as np
import pytest

from o3d_sofnn.compare import colors, raster

VIEW = raster.View((0.0, 0.0, 1.0), (0.0, 1.0, 0.0))
FRAME = raster.Frame(VIEW, np.array([-1.0, -1.0, -1.0]), np.array([1.0, 1.0, 1.0]), 60, 50)
SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])


def test_a_mesh_covers_its_outline_and_nothing_else() -> None:
    half = 0.5 * SQUARE
    pixels = raster.draw_mesh(FRAME, half, FACES, np.full((4, 3), 0.5))
    covered = pixels[:, :, 3] > 127
    side = FRAME.pixels(1.0)
    assert covered.sum() == pytest.approx(side**2, rel=0.1)
    rows, columns = np.nonzero(covered)
    assert (rows.mean(), columns.mean()) == pytest.approx((24.5, 29.5), abs=0.6)
    box = pixels[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1, 3]
    corners = np.ix_([0, -1], [0, -1])
    assert (box[corners] >= 63).all(), "at the corners a fourth of a pixel"
    box[corners] = 255
    assert (box > 127).all()
    assert (box[1:-1, 1:-1] == 255).all()


@pytest.mark.parametrize("order", [1, -1])
def test_the_nearer_of_two_triangles_is_seen(order: int) -> None:
    vertices = np.concatenate(
        [SQUARE - np.array([0, 0, 0.5]), 0.5 * SQUARE + np.array([0, 0, 0.5])]
    )
    faces = np.concatenate([FACES, FACES + 4])[::order]
    tints = np.repeat([[1.0, 0, 0], [0, 0, 1.0]], 4, axis=0)
    pixels = raster.draw_mesh(FRAME, vertices, faces, tints)
    assert pixels[25, 30, 2] > 100
    assert pixels[25, 30, 0] == 0
    assert pixels[5, 10, 0] > 100


def test_a_mesh_far_from_the_origin_looks_the_same() -> None:
    tints = np.full((4, 3), 0.5)
    expected = raster.draw_mesh(FRAME, 0.5 * SQUARE, FACES, tints)
    shift = np.array([500_000.0, 5_400_000.0, 300.0])
    frame = raster.Frame(VIEW, FRAME.low + shift, FRAME.high + shift, 60, 50)
    found = raster.draw_mesh(frame, 0.5 * SQUARE + shift, FACES, tints)
    assert (found != expected).mean() < 0.01


def test_backs_have_a_colour_of_their_own() -> None:
    front = raster.draw_mesh(FRAME, SQUARE, FACES, np.full((4, 3), 0.5))[25, 30]
    back = raster.draw_mesh(FRAME, SQUARE, FACES[:, ::-1], np.full((4, 3), 0.5))[25, 30]
    assert front[0] == front[2]
    assert back[0] > back[2] + 50


def test_triangles_outside_the_picture_do_no_harm() -> None:
    far = np.concatenate([SQUARE + np.array([50.0, 0, 0]), 1e3 * SQUARE])
    pixels = raster.draw_mesh(FRAME, far, np.concatenate([FACES, FACES + 4]), np.full((8, 3), 0.5))
    assert (pixels[:, :, 3] == 255).all()
    assert raster.draw_mesh(FRAME, far[:4], FACES, np.full((4, 3), 0.5)).max() == 0


def test_points_are_discs_and_large_ones_cover() -> None:
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 12)] * 2), -1).reshape(-1, 2)
    points = np.column_stack([grid, np.zeros(len(grid))])
    red = np.tile([1.0, 0.0, 0.0], (len(points), 1))
    loose = raster.draw_points(FRAME, points, red, opaque=False)[10:40, 15:45, 3]
    tight = raster.draw_points(FRAME, points, red, opaque=True)[10:40, 15:45]
    assert 0 < (loose > 127).mean() < 0.9
    assert (tight[:, :, 3] == 255).mean() > 0.97
    assert (tight[:, :, 0] == 255).all()


def test_png_files_are_read_back_as_they_were() -> None:
    image = pytest.importorskip("PIL.Image")
    pixels = np.random.default_rng(0).integers(0, 256, (31, 17, 4)).astype(np.uint8)
    found = np.asarray(image.open(io.BytesIO(raster.encode_png(pixels))))
    np.testing.assert_array_equal(found, pixels)


def test_colours_of_errors_and_sides() -> None:
    heat = colors.heat_colors(np.array([0.0, 1.0, 5.0]), 1.0)
    np.testing.assert_allclose(255 * heat[0], colors.HEAT[0])
    np.testing.assert_array_equal(heat[1], heat[2])
    assert colors.side_colors(np.array([True, False]))[0][0] > 0.7
    np.testing.assert_allclose(colors.direction_colors(np.array([[0.0, 0, 1.0]]))[0], [0.5, 0.5, 1])
