"""The files that the code blocks of the documentation read, small and generated."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapes
from scans import scenes

UTM = np.array([500_000.0, 5_400_000.0, 300.0])


@pytest.fixture(scope="session")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with every file that a block names."""
    o3d = pytest.importorskip("open3d")
    folder = tmp_path_factory.mktemp("inputs")
    torus = shapes.torus(900).noisy(0.01).points
    scan = 0.05 * torus
    room = scenes.make("room", 1600).points
    street = scenes.make("street, three stations", 1600)
    _write(folder / "scan.ply", scan, o3d, colors=0.5 + 0.3 * torus)
    _write(folder / "figure.ply", 10.0 * shapes.torus(900).points, o3d)
    _write(folder / "arch.ply", 10.0 * _bowl(), o3d)
    _write(folder / "depth.ply", _depth_frame(), o3d)
    _write(folder / "room.pcd", room, o3d)
    np.savetxt(folder / "scan.xyz", scan)
    np.savez(folder / "street.npz", positions=street.points, stations=street.stations)
    _write_ptx(folder / "scan.ptx")
    _write_las(folder / "survey.laz", scenes.make("terrain", 1600).points + UTM)
    ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 20)
    assert o3d.io.write_triangle_mesh(str(folder / "model.obj"), ball)
    return folder


@pytest.fixture
def workplace(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder with copies of the files; it is the working directory."""
    shutil.copytree(inputs, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _write(path: Path, points: Any, o3d: Any, colors: Any = None) -> None:
    pcd = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if colors is not None:
        pcd.colors = o3d.utility.Vector3dVector(np.clip(colors, 0.0, 1.0))
    assert o3d.io.write_point_cloud(str(path), pcd)


def _bowl() -> Any:
    """The lower half of a ball, open above."""
    points = shapes.sphere(1600).points
    return points[points[:, 2] < 0.0]


def _depth_frame() -> Any:
    """A table in the frame of its camera: x right, y down, z ahead."""
    camera = np.array([0.1, -1.1, 0.7])
    ahead = np.array([0.0, 0.1, 0.05]) - camera
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(ahead, right), ahead])
    return (scenes.make("table", 2000).points - camera) @ axes.T


def _write_ptx(path: Path) -> None:
    """One scan of a room: rows and columns, place and axes of the scanner, x y z intensity."""
    station = np.array([-0.4, -0.6, 1.4])
    scan = scenes.make("room", 1200)
    local = np.column_stack([scan.points - station, np.full(len(scan.points), 0.5)])
    axes = "1 0 0\n0 1 0\n0 0 1"
    place = " ".join(map(str, station))
    matrix = f"1 0 0 0\n0 1 0 0\n0 0 1 0\n{place} 1"
    rows = "\n".join(" ".join(f"{x:.6f}" for x in row) for row in local)
    path.write_text(f"{len(local)}\n1\n{place}\n{axes}\n{matrix}\n{rows}\n")


def _write_las(path: Path, points: Any) -> None:
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=0, version="1.2")
    header.offsets, header.scales = UTM, np.full(3, 0.001)
    file = laspy.LasData(header)
    file.x, file.y, file.z = points.T
    file.write(str(path))
