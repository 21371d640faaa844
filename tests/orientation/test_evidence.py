"""What decides the sides, and that normals then face where they were seen from."""

from __future__ import annotations

import numpy as np
import pytest
from scans import scenes
from scipy.spatial.transform import Rotation
from shapes import CLOSED, Shape, box, join, plane_patch, sphere

from o3d_sofnn import algorithm1
from o3d_sofnn.orientation.evidence import Evidence
from o3d_sofnn.orientation.lattice import is_depth_image
from o3d_sofnn.orientation.viewpoint import seen_sides
from o3d_sofnn.orientation.visibility import Station
from o3d_sofnn.pipeline import estimate_normals

ERRORS = scenes.Sensor(noise=0.004, mixed=0.3, dropouts=0.05)
DEPTH = scenes.Sensor(noise=0.0015, growth=2.0, mixed=0.3, dropouts=0.05)


@pytest.mark.parametrize(
    ("name", "sensor", "kind"),
    [
        ("room", ERRORS, "density"),
        ("street", ERRORS, "density"),
        ("street, three stations", None, "density"),
        ("table", DEPTH, "density"),
        ("terrain", ERRORS, "height field"),
    ],
)
def test_scans_face_their_scanners_with_no_option(name, sensor, kind):
    scan = scenes.make(name, 16_000 if "three" in name else 9000, sensor, seed=3)
    found = estimate_normals(scan.points)
    assert found.evidence.kind == kind
    assert found.evidence.decided
    assert found.warnings == ()
    assert scan.flipped(found.normals) < 0.02


def depth_frame(sensor=None, axes=None):
    """A frame in the camera's own coordinates, z ahead."""
    solids = scenes.SCENES["table"].solids
    rays = scenes.camera((0.1, -1.1, 0.7), (0.0, 0.1, 0.05), 120, 90)
    scan = scenes.cast(solids, rays, sensor)
    ahead = rays.directions[44:46, 59:61].mean(axis=(0, 1))
    ahead /= np.linalg.norm(ahead)
    right = np.array([ahead[1], -ahead[0], 0.0]) / np.hypot(*ahead[:2])
    camera = np.stack([right, np.cross(ahead, right), ahead])
    camera = camera if axes is None else camera[axes]
    return Shape((scan.points - scan.stations) @ camera.T, scan.normals @ camera.T)


@pytest.mark.parametrize("axes", [[0, 1, 2], [2, 0, 1]])
@pytest.mark.parametrize("sensor", [None, scenes.Sensor(step=0.002, growth=2.0, dropouts=0.1)])
def test_depth_images_are_recognised(sensor, axes):
    frame = depth_frame(sensor, axes)
    assert is_depth_image(frame.points)
    assert is_depth_image(frame.points.astype(np.float32).astype(np.float64))
    assert is_depth_image(-frame.points)
    turned = frame.points @ Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix()
    assert not is_depth_image(turned)
    assert not is_depth_image(frame.points + 0.1)


def test_a_depth_image_faces_its_camera():
    frame = depth_frame(scenes.Sensor(step=0.002, growth=2.0, mixed=0.3))
    found = estimate_normals(frame.points)
    assert found.evidence.kind == "depth image"
    assert (np.einsum("nd,nd->n", found.normals, frame.points) < 0.05).mean() > 0.99


def grids():
    """Regular clouds that no camera has made."""
    line = np.arange(24.0)
    voxels = np.stack(np.meshgrid(line, line, line), -1).reshape(-1, 3)
    ball = voxels[np.abs(np.linalg.norm(voxels - 11.5, axis=1) - 10.0) < 0.6]
    x, y = np.meshgrid(np.linspace(0.0, 1.0, 60), np.linspace(0.0, 1.0, 60))
    z = 1.0 + 0.2 * np.sin(5.0 * x) * np.cos(4.0 * y)
    return {
        "voxels": ball + 3.0,
        "height map": np.stack([x, y, z], -1).reshape(-1, 3),
        "plane": np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3),
        "random": sphere(5000).points + 3.0,
    }


@pytest.mark.parametrize("name", grids())
def test_other_grids_are_no_depth_images(name):
    assert not is_depth_image(grids()[name])


@pytest.mark.parametrize("name", CLOSED)
def test_closed_shapes_are_decided_outward(name):
    shape = CLOSED[name]
    for points in (shape.points, shape.noisy(0.005).points, shape.points + 3.0):
        evidence = estimate_normals(points).evidence
        assert evidence.kind == "outward"
        assert evidence.sight is None


def corner(n):
    """Two walls and the floor of a room in a camera's frame, x right, y down, z ahead."""
    rng = np.random.default_rng(0)
    points, normals = [], []
    for axis, sign in ((0, -1.0), (1, 1.0), (2, 1.0)):
        wall = rng.uniform([-1.5, -1.0, 2.0], [1.5, 1.0, 4.5], (n, 3))
        wall[:, axis] = {0: -1.5, 1: 1.0, 2: 4.5}[axis]
        points.append(wall)
        normals.append(np.tile(-sign * np.eye(3)[axis], (n, 1)))
    return Shape(np.concatenate(points), np.concatenate(normals))


def test_the_corner_of_a_room_faces_the_camera_at_the_origin():
    shape = corner(1500)
    found = estimate_normals(shape.points)
    assert found.evidence.kind == "camera"
    assert ((found.normals * shape.normals).sum(axis=1) > 0.0).mean() > 0.995
    moved = estimate_normals(shape.points + 30.0)
    assert moved.evidence.kind != "camera"


def test_a_doubtful_station_is_believed_of_open_surfaces_only(monkeypatch):
    wall = plane_patch(2000, 4.0)
    wall = Shape(wall.points[:, [2, 0, 1]], wall.normals[:, [2, 0, 1]])
    shape = join(sphere(2000).moved((0.0, 8.0, 0.0)), wall)
    for side in (1.0, -1.0):
        station = Station(np.array([9.0 * side, 0.0, 0.0]))
        said = Evidence("density", "", {"hidden": 0.1}, station, sure=False)
        monkeypatch.setattr(algorithm1, "found", lambda *_, said=said: said)
        found = estimate_normals(shape.points)
        assert found.evidence.kind == "density"
        assert ((found.normals * shape.normals).sum(axis=1)[:2000] > 0.0).all()
        assert (side * found.normals[2000:, 0] > 0.9).all()


def test_roof_and_ground_both_face_up():
    """A flat roof above the ground, without walls: a piece of its own."""
    roof = plane_patch(1500, 2.0).moved((0.0, 0.0, 1.0))
    ground = plane_patch(6000, 6.0)
    outside = np.abs(ground.points[:, :2]).max(axis=1) > 1.0
    ground = Shape(ground.points[outside], ground.normals[outside])
    found = estimate_normals(join(roof, ground).points)
    assert found.evidence.kind == "height field"
    assert (found.normals[:, 2] > 0.9).all()


def test_towards_turns_every_point():
    shape = join(plane_patch(1000), plane_patch(1000, seed=1).moved((0.0, 0.0, 1.0)))
    for sign in (1.0, -1.0):
        found = estimate_normals(shape.points, towards=np.array([0.0, 0.0, sign]))
        assert found.evidence.kind == "towards"
        assert (sign * found.normals[:, 2] > 0.9).all()
    ball = estimate_normals(sphere(2000).points, towards=np.array([0.0, 0.0, 1.0]))
    assert (ball.normals[:, 2] > -0.06).all()


def test_walls_seen_along_themselves_follow_what_is_around_them():
    shape = box(6000, (1.0, 1.0, 0.6))
    seen = shape.points[:, 2] > -0.29
    shape = Shape(shape.points[seen], shape.normals[seen])
    side = np.random.default_rng(0).normal(0.0, 0.05, shape.points.shape)
    normals = shape.normals + side
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    up = np.tile([0.0, 0.0, 1.0], (len(normals), 1))
    for sign in (1.0, -1.0):  # the winding number may have all of it inside out
        turned = seen_sides(up, sign * normals, shape.points)
        assert ((turned * shape.normals).sum(axis=1) > 0.0).mean() > 0.99
    unknown = seen_sides(0.0 * up, -normals, shape.points)
    np.testing.assert_array_equal(unknown, -normals)
