"""Runs over tiles: the same bits whoever does the work, and nothing is done twice."""

from __future__ import annotations

import errno
import shutil
import threading
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import pytest
from mesh_checks import assert_valid_mesh
from shapes import box, plane_patch, sphere

from o3d_sofnn import reconstruct_surface
from o3d_sofnn._kernels import nearest_triangles
from o3d_sofnn.files.readers.ply import read_ply_mesh
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.options import Options
from o3d_sofnn.tiles.work.engine import Engine
from o3d_sofnn.tiles.work.run import Cloud, run_tiles
from o3d_sofnn.tiles.work.tasks import finish_task, mesh_task

BALL = sphere(1600).points * np.array([0.95, 0.95, 0.4])
"""Flat, so that there are four tiles with points, and four without."""


class Given(Cloud):
    """Points in memory, in small parts."""

    def __init__(self, points):
        self.points = points

    def chunks(self):
        for start in range(0, len(self.points), 700):
            yield self.points[start : start + 700]


class Backwards(Executor):
    """Does what it was given last first, in another thread."""

    def __init__(self):
        self.waiting, self.timer = [], None

    def submit(self, function, /, *args, **named):
        future = Future()
        self.waiting.append((future, function, args))
        if self.timer is not None:
            self.timer.cancel()
        self.timer = threading.Timer(0.1, self.work)
        self.timer.start()
        return future

    def work(self):
        while self.waiting:
            future, function, args = self.waiting.pop()
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(function(*args))
                except Exception as error:
                    future.set_exception(error)


class Here(Executor):
    """Does everything at once, and counts; some tasks fail."""

    def __init__(self, fails=None):
        self.fails, self.done = fails, []

    def submit(self, function, /, *args, **named):
        future = Future()
        try:
            work, number = function.args[0], args[0]
            if self.fails is not None and (error := self.fails(work, number)) is not None:
                raise error
            future.set_result(function(*args))
            self.done.append((work, number))
        except Exception as error:
            future.set_exception(error)
        return future


def run(points, out, executor=None, n=600, renew=None, **options):
    out.mkdir(exist_ok=True)
    engine = Engine(executor or Here(), renew)
    return run_tiles(
        Given(points), out, Options(**options), engine, points_per_tile=n, identity={"n": 1}
    )


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    out = tmp_path_factory.mktemp("ball")
    return run(BALL, out), out


def test_a_ball_of_tiles_is_closed_and_like_that_of_one_run(ball):
    reached, out = ball
    vertices, triangles = read_ply_mesh(out / "mesh.ply")
    assert reached.report["tiles"] == 4
    assert reached.report["watertight"]
    assert_valid_mesh(vertices, triangles.astype(np.int32), components=1)
    one = reconstruct_surface(BALL)
    spacing = np.sqrt(7.5 / len(BALL))
    distance = nearest_triangles(*one, np.ascontiguousarray(vertices), 1)[0]
    assert np.mean(distance) < 0.03 * spacing
    assert np.max(distance) < 0.2 * spacing


@pytest.mark.parametrize("executor", [Backwards(), ThreadPoolExecutor(3)])
def test_the_order_of_the_work_changes_no_bit(ball, tmp_path, executor):
    run(BALL, tmp_path / "out", executor)
    assert (tmp_path / "out" / "mesh.ply").read_bytes() == (ball[1] / "mesh.ply").read_bytes()


def test_a_run_that_failed_goes_on_from_what_is_finished(ball, tmp_path):
    def full(work, number):
        if work is mesh_task and number == 1:
            return OSError(errno.ENOSPC, "No space left on device", "meshes/000001.npz")
        return None

    first, again = Here(full), Here()
    with pytest.raises(OSError, match="000001"):
        run(BALL, tmp_path / "out", first)
    run(BALL, tmp_path / "out", again)
    assert [each for each in again.done if each[0] is not finish_task] == [(mesh_task, 1)]
    assert (tmp_path / "out" / "mesh.ply").read_bytes() == (ball[1] / "mesh.ply").read_bytes()


@pytest.mark.parametrize("stage", ["meshes", "seams"])
def test_a_damaged_file_is_made_again(ball, tmp_path, stage):
    shutil.copytree(ball[1], tmp_path / "out")
    damaged = tmp_path / "out" / "work" / stage / "000001.npz"
    raw = bytearray(damaged.read_bytes())
    raw[len(raw) // 2] ^= 1
    damaged.write_bytes(raw)
    again = Here()
    run(BALL, tmp_path / "out", again)
    assert again.done == [(mesh_task, 1)]
    assert (tmp_path / "out" / "mesh.ply").read_bytes() == (ball[1] / "mesh.ply").read_bytes()


def test_a_worker_that_dies_costs_a_retry(ball, tmp_path):
    died = []

    def dies(work, number):
        if work is mesh_task and number == 1 and not died:
            died.append(number)
            return BrokenProcessPool("a process was terminated")
        return None

    run(BALL, tmp_path / "out", Here(dies), renew=lambda: Here(dies))
    assert died == [1]
    assert (tmp_path / "out" / "mesh.ply").read_bytes() == (ball[1] / "mesh.ply").read_bytes()


def test_points_that_were_cut_short_are_named(ball, tmp_path):
    shutil.copytree(ball[1], tmp_path / "out")
    work = tmp_path / "out" / "work"
    (work / "surveys" / "000000.npz").unlink()
    cut = work / "points" / "000000.f8"
    cut.write_bytes(cut.read_bytes()[:-24])
    with pytest.raises(ValueError, match=r"000000\.f8: expected .* points"):
        run(BALL, tmp_path / "out")


def test_a_pool_that_always_breaks_ends_the_run(tmp_path):
    def dies(*_):
        return BrokenProcessPool("a process was terminated")

    with pytest.raises(BrokenProcessPool):
        run(BALL, tmp_path / "out", Here(dies), renew=lambda: Here(dies))


def test_another_job_in_the_same_folder_is_refused(ball):
    with pytest.raises(ValueError, match="work directory"):
        run(BALL, ball[1], closed=False)


def test_a_sheet_of_tiles_has_one_rim(tmp_path):
    points = 1.9 * plane_patch(1600).noisy(0.002).points
    reached = run(points, tmp_path / "out")
    vertices, triangles = read_ply_mesh(tmp_path / "out" / "mesh.ply")
    triangles = triangles.astype(np.int32)
    assert reached.report["components"] == 1
    assert mesh_properties.is_edge_manifold(triangles)
    assert mesh_properties.is_vertex_manifold(triangles)
    assert mesh_properties.is_consistently_wound(triangles)
    assert mesh_properties.euler_characteristic(triangles) == 1, "a disc: no hole along the seams"
    assert np.ptp(vertices[:, :2], axis=0) == pytest.approx([1.9, 1.9], abs=0.2)


def test_coordinates_far_from_the_origin_keep_their_digits(tmp_path):
    points = box(1600, (3.8, 3.8, 3.8)).points + np.array([4.5e6, 5.5e5, 300.0])
    run(points, tmp_path / "out", n=900)
    vertices, triangles = read_ply_mesh(tmp_path / "out" / "mesh.ply")
    assert_valid_mesh(vertices - points.mean(axis=0), triangles.astype(np.int32), components=1)
    inside = vertices - np.array([4.5e6, 5.5e5, 300.0])
    assert np.median(np.abs(np.abs(inside).max(axis=1) - 1.9)) < 1e-3
