"""Two near sheets are told from one noisy sheet."""

from __future__ import annotations

import numpy as np
import pytest
from shapes import box, join, plane_patch, sphere

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.pipeline import estimate_normals
from o3d_sofnn.sampling.cells import sort_unique
from o3d_sofnn.sampling.scales.choice import Limits, choose_scale
from o3d_sofnn.sampling.scales.layers import layered

SPACING = np.sqrt(1.0 / 1500)
"""Of the points of the sheets below."""


def sheets(gap, noise=0.0):
    """Two squares, `gap` and `noise` in spacings."""
    below = plane_patch(1500, seed=0)
    above = plane_patch(1500, seed=1).moved((0.0, 0.0, gap * SPACING))
    return join(below, above).noisy(noise * SPACING).points


def measured(points):
    """Share of the variance left, noise within and noise found, medians, the latter in spacings."""
    points = np.ascontiguousarray(points[sort_unique(points)[0]])
    tree = KdTree(points, 1)
    left, within = layered(points, tree, points[::10])
    found = choose_scale(points, tree, Limits()).noise
    return np.median(left), np.median(within) / SPACING, np.median(found) / SPACING


@pytest.mark.parametrize("gap", [1.0, 1.2, 1.6, 2.0])
def test_clean_sheets_have_no_noise(gap):
    left, _, found = measured(sheets(gap))
    assert left < 0.22  # few points of the other sheet are around if the gap is large
    assert found < 0.02


def test_noise_within_sheets_is_found():
    left, within, found = measured(sheets(1.4, noise=0.15))
    assert left < 0.2
    assert 0.1 < within < 0.25
    assert 0.1 < found < 0.25


@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_one_noisy_sheet_stays_one(noise):
    left, _, found = measured(plane_patch(1500).noisy(noise * SPACING).points)
    assert left > 0.3
    assert found == pytest.approx(noise, rel=0.1)


def test_even_noise_is_no_pair_of_sheets():
    rng = np.random.default_rng(0)
    points = plane_patch(3000).points + rng.uniform(-1.0, 1.0, (3000, 3)) * [0.0, 0.0, SPACING]
    assert measured(points)[0] > 0.22


def test_a_curved_wall_has_two_layers():
    inner = sphere(1500, 1.0 - 1.2 * np.sqrt(4.0 * np.pi / 1500), seed=1)
    left, within, _ = measured(join(sphere(1500), inner).points)
    assert left < 0.2
    assert within < 0.2


def flipped(shape):
    normals = estimate_normals(shape.points).normals
    return (np.einsum("nd,nd->n", normals, shape.normals) <= 0.0).mean()


@pytest.mark.parametrize("gap", [1.0, 1.5, 2.0])
@pytest.mark.parametrize("seed", [5, 6])
def test_thin_plates_are_solids(gap, seed):
    plate = box(3000, (1.0, 1.0, gap * np.sqrt(2.0 / 3000)), seed=seed)
    assert flipped(plate) < 0.01
    assert not estimate_normals(plate.points).warnings


def test_boards_with_a_narrow_gap_face_each_other():
    size = (1.0, 1.0, 0.4)
    below, above = box(2000, size, seed=3), box(2000, size, seed=4)
    gap = 1.5 * np.sqrt(2.0 * 3.6 / 4000)
    assert flipped(join(below, above.moved((0.0, 0.0, size[2] + gap)))) < 0.01
