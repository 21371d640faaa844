"""The comparison inside MeshLab runs, and its table is what its CSV says."""

from __future__ import annotations

import csv
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pymeshlab = pytest.importorskip("pymeshlab", reason="PyMeshLab is not installed")

DEMO = Path(__file__).parents[2] / "demos" / "meshlab.py"
METHODS = {"meshlab_sofnn": "ours", "meshlab_ball_pivoting": "ball pivoting"}  # the fastest


def run(*arguments: Any) -> Any:
    return subprocess.run(
        [sys.executable, DEMO, "--quick", "--points", "1500", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def test_every_method_is_measured(tmp_path: Path) -> None:
    ms = pymeshlab.MeshSet()
    ms.create_sphere(subdiv=4)
    ms.save_current_mesh(str(tmp_path / "ball.ply"))
    done = run(tmp_path / "ball.ply", "--out", tmp_path, "--methods", *METHODS)
    assert done.returncode == 0, done.stdout + done.stderr
    with (tmp_path / "meshlab.csv").open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["input"], row["method"]) for row in rows] == [
        (name, method) for name in ("ball, 0 %", "ball, 0.5 %") for method in METHODS
    ]
    for row in rows:
        assert row["error"] == ""
        assert float(row["chamfer"]) < 10.0
        own_normals = row["method"] == "meshlab_sofnn"
        assert (float(row["normals_seconds"]) == 0.0) == own_normals
        assert float(row["seconds"]) > float(row["normals_seconds"])
        assert (row["flipped"] == "") == own_normals
        if own_normals:
            assert (float(row["watertight"]), float(row["components"])) == (1.0, 1.0)
            assert float(row["normal_consistency"]) > 0.9
    lines = (tmp_path / "meshlab.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) == 2 + len(rows) + len(METHODS)
    for line, row in zip(lines[2:], rows, strict=False):
        cells = [cell.strip() for cell in line.split("|")[1:-1]]
        assert cells[:2] == [row["input"], METHODS[row["method"]]]
        assert float(cells[4]) == pytest.approx(float(row["chamfer"]), rel=0.01)


def test_an_open_mesh_is_no_truth_and_the_others_go_on(tmp_path: Path) -> None:
    ms = pymeshlab.MeshSet()
    ms.create_grid()
    ms.save_current_mesh(str(tmp_path / "sheet.ply"))
    ms.create_sphere()
    ms.save_current_mesh(str(tmp_path / "ball.ply"))
    files = [tmp_path / name for name in ("missing.ply", "sheet.ply", "ball.ply")]
    small = ["--quick", "--points", "500", "--methods", "meshlab_sofnn"]
    done = run(*files, *small, "--out", tmp_path / "out")
    assert done.returncode == 1
    assert "missing.ply: " in done.stdout
    assert "sheet.ply: expected a closed mesh" in done.stdout
    assert (tmp_path / "out" / "meshlab.csv").read_text(encoding="utf-8").count("ball") == 2
