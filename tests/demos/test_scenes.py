"""Scans of made scenes: points where the formulas put them, normals of the sides seen."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from scans import scenes
from scipy.spatial import cKDTree

CENTER = np.array([1.0, 2.0, 0.5])
SOLIDS = {
    "ball": (
        scenes.Ball((1.0, 2.0, 0.5), 0.7),
        lambda x: np.linalg.norm(x - CENTER, axis=1) - 0.7,
    ),
    "box": (
        scenes.Box((1.0, 2.0, 0.5), (0.8, 1.0, 0.6)),
        lambda x: (np.abs(x - CENTER) / [0.4, 0.5, 0.3]).max(axis=1) - 1.0,
    ),
    "pipe": (
        scenes.Pipe((1.0, 2.0, -1.0), (1.0, 2.0, 2.0), 0.4),
        lambda x: np.linalg.norm((x - CENTER)[:, :2], axis=1) - 0.4,
    ),
    "ground": (
        scenes.Ground(lambda x, y: 0.3 * np.sin(x) + 0.1 * y, 5.0),
        lambda x: x[:, 2] - 0.3 * np.sin(x[:, 0]) - 0.1 * x[:, 1],
    ),
}


@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("name", SOLIDS)
def test_rays_meet_the_surface_and_normals_are_its_gradient(name, inside):
    solid, implicit = SOLIDS[name]
    station = CENTER + ([0.05, -0.1, 0.02] if inside else [-2.0, 1.5, 1.2])
    scan = scenes.cast([solid], scenes.tripod(station, 240, 120, -80.0, 80.0))
    assert len(scan.points) > 50
    assert np.abs(implicit(scan.points)).max() < 1e-9
    towards = np.einsum("nd,nd->n", scan.normals, scan.stations - scan.points)
    assert (towards > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(scan.normals, axis=1), 1.0, atol=1e-12)
    step = 1e-6 * np.eye(3)
    gradient = np.stack([implicit(scan.points + e) - implicit(scan.points - e) for e in step], -1)
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    smooth = np.abs(np.einsum("nd,nd->n", gradient, scan.normals)) > 1.0 - 1e-6
    assert smooth.mean() > (0.99 if name != "box" else 0.9)  # an edge has two normals


def test_nothing_is_seen_behind_anything():
    front, back = scenes.Ball((2.0, 0.0, 0.0), 0.5), scenes.Ball((5.0, 0.0, 0.0), 2.0)
    rays = scenes.camera((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 200, 150)
    scan = scenes.cast([back, front], rays)
    off = np.linalg.norm(scan.points[:, 1:], axis=1) / np.linalg.norm(scan.points, axis=1)
    behind = scan.points[:, 0] > 2.7
    assert behind.any()
    assert off[behind].min() > 0.25 > off[~behind].max() - 1e-6


def test_a_camera_sees_a_lattice_and_counts_disparities():
    wall = [scenes.Box((0.0, 5.0, 0.0), (20.0, 2.0, 20.0), 20.0)]
    rays = scenes.camera((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 64, 48)
    scan = scenes.cast(wall, rays, scenes.Sensor(step=0.002, growth=2.0))
    image = scan.points[:, [0, 2]] / scan.points[:, 1:2]
    assert len(np.unique(image[:, 0].round(9))) == 64
    assert len(np.unique(image[:, 1].round(9))) == 48
    counts = 1.0 / (0.002 * scan.points[:, 1])
    np.testing.assert_allclose(counts, counts.round(), atol=1e-6)
    assert len(np.unique(counts.round())) > 5


def test_errors_lie_along_the_rays_and_have_the_size_asked_for():
    truth = scenes.make("room", 5000)
    sensor = scenes.Sensor(noise=0.01, mixed=0.5, dropouts=0.2)
    scan = scenes.make("room", 5000, sensor, seed=1)
    assert 0.75 < len(scan.points) / len(truth.points) < 0.85
    rays = scan.points - scan.stations
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    true_rays = truth.points - truth.stations
    true_ranges = np.linalg.norm(true_rays, axis=1)
    off, same = cKDTree(true_rays / true_ranges[:, None]).query(rays)
    assert off.max() < 1e-6
    ranges = np.linalg.norm(scan.points - scan.stations, axis=1)
    error = (ranges - true_ranges[same])[~scan.stray]
    assert 0.009 < error.std() < 0.011
    assert 0.001 < scan.stray.mean() < 0.05


@pytest.mark.parametrize("name", scenes.SCENES)
def test_scenes_are_what_their_stations_see(name):
    scan = scenes.make(name, 2000)
    assert 600 < len(scan.points) < 3000
    towards = np.einsum("nd,nd->n", scan.normals, scan.stations - scan.points)
    assert (towards > 0.0).all()
    assert scan.flipped(scan.normals) == 0.0
    assert scan.flipped(-scan.normals) == 1.0
    again = scenes.make(name, 2000)
    np.testing.assert_array_equal(again.points, scan.points)


def test_the_program_writes_every_scene(tmp_path, monkeypatch):
    from scenes.__main__ import main

    monkeypatch.setattr(sys, "argv", ["scenes", "--out", str(tmp_path), "-n", "300"])
    assert main() == 0
    files = sorted(tmp_path.glob("*.xyz"))
    assert len(files) == len(scenes.SCENES)
    assert all(np.loadtxt(file).shape[1] == 6 for file in files)
