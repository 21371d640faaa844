"""Scanners found from the density, and what they see."""

from __future__ import annotations

import numpy as np
import pytest
from scans import scenes
from scipy.spatial.transform import Rotation
from shapes import CLOSED, box, sphere, torus

from o3d_sofnn.geometry.vectors import even_directions
from o3d_sofnn.orientation.density import Density
from o3d_sofnn.orientation.station import find_stations
from o3d_sofnn.orientation.visibility import Discs, Several, Station, hidden
from o3d_sofnn.sampling.normalization import unit_cube
from o3d_sofnn.sampling.outliers import part_outliers
from o3d_sofnn.sampling.scales.choice import Limits


def samples_of(points):
    cloud = unit_cube(points)
    return part_outliers(cloud.points, Limits()), cloud.frame


def places_found(points):
    """Places of the stations in the user's coordinates, (k, 3), or None."""
    samples, frame = samples_of(points)
    found = find_stations(samples, frame.origin)
    if found is None:
        return None
    return np.array([frame.outside(station.place) for station in found.stations])


def true_discs(points, normals):
    spacing = np.full(len(points), np.sqrt(4.0 * np.pi / len(points)))
    return Discs(points, normals, spacing**2, spacing)


@pytest.mark.parametrize("turning", [False, True])
def test_slopes_are_those_of_the_errors(turning):
    scan = scenes.make("room", 600)
    one = np.ones(len(scan.points))
    discs = Discs(scan.points, scan.normals, one, one)
    density = Density.of(discs, turning)
    stations = np.array([[0.3, -0.2, 1.1], [2.0, 1.0, 1.7]])
    slopes = density.slopes(stations)
    for column in range(6):
        step = np.zeros(6)
        step[column] = 1e-6
        more, less = (density.errors(stations + s * step.reshape(2, 3)) for s in (1.0, -1.0))
        np.testing.assert_allclose(slopes[:, column], (more - less) / 2e-6, atol=1e-4, rtol=1e-4)


def test_a_perfect_scan_has_the_density_of_its_station():
    scan = scenes.make("room", 8000)
    samples, frame = samples_of(scan.points)
    density = Density.of(Discs.of(samples, 1500), True)
    truth = (scan.stations[:1] - frame.middle) / frame.extent
    assert density.spread(truth) < 0.06 < 0.3 < density.spread(truth + 0.2)
    several = density.spreads(np.stack([truth, truth + 0.3]))
    np.testing.assert_allclose(several, [density.spread(truth), density.spread(truth + 0.3)])


@pytest.mark.parametrize("name", ["room", "street", "terrain, station", "pipes", "table"])
def test_one_scanner_is_found(name):
    sensor = scenes.Sensor(noise=0.003, mixed=0.3, dropouts=0.05)
    scan = scenes.make(name, 8000, sensor, seed=1)
    places = places_found(scan.points)
    assert len(places) == 1
    distance = np.linalg.norm(scan.points - scan.stations[0], axis=1)
    assert np.linalg.norm(places[0] - scan.stations[0]) < 0.2 * np.median(distance)


@pytest.mark.parametrize(
    ("name", "count"), [("room, two stations", 2), ("street, three stations", 3)]
)
def test_several_scanners_are_found(name, count):
    scan = scenes.make(name, 16_000, seed=2)
    places, truth = places_found(scan.points), np.unique(scan.stations, axis=0)
    assert len(places) == len(truth) == count
    off = np.linalg.norm(places[:, None] - truth, axis=2)
    assert off.min(axis=0).max() < 0.5
    assert sorted(off.argmin(axis=1)) == list(range(count))


def test_stations_move_with_the_cloud():
    scan = scenes.make("street", 6000)
    places = places_found(scan.points)
    turn = Rotation.from_euler("z", 1.0).as_matrix()
    moved = places_found(30.0 * scan.points @ turn.T + [5e5, 5e6, 100.0])
    np.testing.assert_allclose(moved, 30.0 * places @ turn.T + [5e5, 5e6, 100.0], atol=30.0)


def test_the_origin_is_taken_where_it_explains_as_much():
    scan = scenes.make("room", 8000, scenes.Sensor(noise=0.01), seed=1)
    np.testing.assert_allclose(places_found(scan.points - scan.stations)[0], 0.0, atol=1e-12)


def uneven(shape, thinned=30.0):
    """Fewer and fewer points from one end to the other."""
    x = shape.points[:, 0]
    keep = np.random.default_rng(0).random(len(x)) < thinned ** -((x - x.min()) / np.ptp(x))
    return shape.points[keep]


LATITUDE, LONGITUDE = np.meshgrid(np.pi * np.arange(31) / 30.0, np.pi * np.arange(60) / 30.0)
BALL = np.stack(
    [
        np.sin(LATITUDE) * np.cos(LONGITUDE),
        np.sin(LATITUDE) * np.sin(LONGITUDE),
        np.cos(LATITUDE),
    ],
    axis=-1,
).reshape(-1, 3)
SPIRAL = even_directions(6000)
OBJECTS = {
    **{name: shape.points for name, shape in CLOSED.items()},
    "uneven box": uneven(box(12_000, (1.0, 0.6, 0.4))),
    "uneven torus": uneven(torus(12_000)),
    "uneven sphere": uneven(sphere(12_000)),
    "ball of longitudes and latitudes": BALL,
    "ellipsoid of longitudes and latitudes": BALL * [1.0, 2.0, 0.5],
    "cube drawn around its middle": (u := even_directions(6000))
    / np.abs(u).max(axis=1, keepdims=True),
    "cuboid drawn around its middle": SPIRAL
    / np.abs(SPIRAL / [3.0, 2.0, 1.0]).max(axis=1, keepdims=True),
}


@pytest.mark.parametrize("name", OBJECTS)
def test_nobody_stands_around_or_in_a_closed_object(name):
    assert places_found(OBJECTS[name]) is None


@pytest.mark.parametrize("far", [False, True])
def test_the_back_of_a_ball_is_hidden(far):
    ball = sphere(4000)
    discs = true_discs(ball.points, ball.normals)
    station = Station(np.array([0.0, 0.0, 1.0 if far else 3.0]), far)
    cosine = np.einsum("nd,nd->n", ball.normals, station.directions(ball.points))
    lost = hidden(discs, station, np.arange(4000))
    back = ball.points[:, 2] < (0.0 if far else 1.0 / 3.0)
    rim = np.abs(cosine) < 0.3
    assert lost[back & ~rim].mean() > 0.8
    assert not lost[~back & ~rim].any()


def test_a_ball_hides_the_wall_behind_it():
    wall = scenes.Box((0.0, 3.0, 0.0), (6.0, 0.2, 6.0))
    ball = scenes.Ball((0.0, 1.5, 0.0), 0.5)
    rays = scenes.camera((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 80, 80)
    whole, front = scenes.cast([wall], rays), scenes.cast([ball, wall], rays)
    near = front.points[:, 1] < 2.0
    points = np.vstack([whole.points, front.points[near]])
    discs = true_discs(points, np.vstack([whole.normals, front.normals[near]]))
    lost = hidden(discs, Station(np.zeros(3)), np.arange(len(points)))
    behind = np.zeros(len(points), bool)
    behind[: len(whole.points)] = near
    assert (lost == behind).mean() > 0.97
    aside = hidden(discs, Station(np.array([1.0, 0.0, 0.0]), far=True), np.arange(len(points)))
    assert aside[-near.sum() :].mean() < 0.6


def test_each_place_looks_to_the_station_that_sees_it():
    surface = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 9.0, 0.0]])
    stations = np.array([[-1.0, 0.0, 2.0], [1.0, 0.0, -1.0]])
    seen = np.array([[True, False, False], [False, True, False]])
    sight = Several(stations, surface, seen)
    found = sight.directions(surface + 0.01)
    assert found[0, 2] > 0.0 > found[1, 2]
    # What no station sees looks to all of them, most to the nearest.
    each = [(s - surface[2] - 0.01) for s in stations]
    expected = sum(ray / np.linalg.norm(ray) ** 3 for ray in each)
    np.testing.assert_allclose(found[2], expected)
