"""Several sweeps on the command line, and a folder that is watched."""

import json
import threading
import time
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
from mesh_checks import assert_valid_mesh
from shapes import torus

from o3d_sofnn.cli import main
from o3d_sofnn.online import command

POINTS = torus(3000).points
SWEEPS = np.array_split(np.argsort(POINTS[:, 0], kind="stable"), 3)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "SETTLED", 0.05)
    Path("scans").mkdir()
    return tmp_path


def drop(number: int) -> None:
    part = Path(f"scans/.{number}.part")
    part.write_text("\n".join(f"{x} {y} {z}" for x, y, z in POINTS[SWEEPS[number]]))
    part.rename(f"scans/{number}.xyz")


def read(path: str) -> tuple[np.ndarray, np.ndarray]:
    mesh = o3d.io.read_triangle_mesh(path)
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles)


def test_several_files_become_one_mesh(folder: Path) -> None:
    for i in range(3):
        drop(i)
    names = [f"scans/{i}.xyz" for i in range(3)]
    assert main.main(["reconstruct", *names, "all.ply", "--json", "all.json"]) == 0
    assert_valid_mesh(*read("all.ply"))
    report = json.loads(Path("all.json").read_text())
    assert report["inputs"] == names
    assert report["triangles"] == len(read("all.ply")[1])
    assert main.main(["reconstruct", "scans", "again.ply"]) == 0
    np.testing.assert_array_equal(read("again.ply")[0], read("all.ply")[0])


def test_a_folder_is_watched(folder: Path) -> None:
    drop(0)
    thread = threading.Thread(
        target=lambda: (time.sleep(0.5), drop(1), time.sleep(0.5), drop(2)), daemon=True
    )
    thread.start()
    arguments = ["watch", "scans", "scans/out.ply", "--idle", "2", "--json", "report.json"]
    assert main.main(arguments) == 0
    thread.join()
    report = json.loads(Path("report.json").read_text())
    assert report["inputs"] == [f"scans/{i}.xyz" for i in range(3)]
    assert_valid_mesh(*read("scans/out.ply"))


def test_once_takes_what_is_there_and_leaves_out_what_cannot_be_read(
    folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for i in range(3):
        drop(i)
    Path("scans/bad.ply").write_text("no ply")
    assert main.main(["watch", "scans", "out.ply", "--once"]) == 0
    assert "scans/bad.ply: left out" in capfd.readouterr().err
    assert_valid_mesh(*read("out.ply"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["watch", "none", "out.ply", "--once"], "none: expected a folder"),
        (["watch", "scans", "out.doc", "--once"], "out.doc: "),
        (["watch", "scans", "out.ply", "--once"], "scans: expected point files in it"),
        (["watch", "scans", "out.ply", "--idle", "0"], "--idle: expected a positive number"),
        (["reconstruct", "a.xyz", "b.xyz", "out.ply", "--use-normals"], "--use-normals: expected"),
        (["reconstruct", "a.xyz", "b.xyz", "out.ply", "--attributes"], "--attributes: expected"),
        (["reconstruct", "a.xyz", "b.xyz", "out.ply"], "a.xyz"),
        (["reconstruct", "a.xyz", "b.xyz", "out.ply", "--depth", "99"], "--depth"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(
    folder: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert main.main([*arguments, "--progress", "none"]) == main.BAD_INPUT
    error = capfd.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not Path("out.ply").exists()
