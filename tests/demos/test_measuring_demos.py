"""The demos that measure: their tables come out, with what a known shape must have."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from demo_runs import DEMOS, Run, run_demo
from report_page import read_csv

o3d = pytest.importorskip("open3d")
pytest.importorskip("pymeshlab")


@pytest.fixture
def run(tmp_path: Path) -> Run:
    return partial(run_demo, tmp_path)


def test_benchmark_goes_on_where_it_stopped(run: Run, tmp_path: Path) -> None:
    tasks = ["ours_normals", "open3d_normals", "ours_mesh", "ours_mesh_1", "open3d_poisson"]
    arguments = ["--sizes", "3714", "--repeats", "1", "--tasks", *tasks]
    first = run("benchmarks/speed/bench", *arguments)
    assert first.returncode == 0, first.stderr
    assert "mesh / Open3D Poisson given normals" in first.stdout
    assert "| yes |" in first.stdout  # the same bits with one thread
    log = tmp_path / "build" / "bench" / "bench.jsonl"
    before = log.read_text()
    again = run("benchmarks/speed/bench", *arguments)
    assert again.returncode == 0, again.stderr
    assert log.read_text() == before
    assert again.stdout == (tmp_path / "build" / "bench" / "bench.md").read_text() + "\n"


def test_limits_of_every_stage(run: Run) -> None:
    result = run("benchmarks/speed/limits", "--points", "3000", "--repeats", "1")
    assert result.returncode == 0, result.stderr
    stages = [line.split("|")[1].strip() for line in result.stdout.splitlines() if "|" in line]
    assert {"cells", "orientation", "surface"} <= set(stages)


def test_sides_prints_both_tables(run: Run, tmp_path: Path) -> None:
    np.savetxt(tmp_path / "sheet.xyz", np.random.default_rng(0).random((800, 3)) * [1.0, 1.0, 0.0])
    done = run("benchmarks/accuracy/sides", "sheet.xyz", "-n", 3000, "--scenes", "room", "table")
    assert done.returncode == 0, done.stderr
    rows = [line.split("|")[1:-1] for line in done.stdout.splitlines() if line.startswith("| ")]
    assert [row[2].strip() for row in rows[1:5]] == 4 * ["density"]
    assert max(float(row[4]) for row in rows[1:5]) < 5.0
    assert rows[-1][0].strip() == "sheet.xyz"
    assert float(rows[-1][3]) == 100.0


def test_orientation_prints_both_tables(run: Run) -> None:
    done = run("benchmarks/accuracy/orientation", "-n", 1500)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n| plate") == 3
    assert "least confident first" in done.stdout


@pytest.fixture
def ball(tmp_path: Path) -> Path:
    file = tmp_path / "ball.ply"
    o3d.io.write_triangle_mesh(str(file), o3d.geometry.TriangleMesh.create_sphere(1.0, 40))
    return file


def test_normals_are_measured_beside_fixed_fits(run: Run, ball: Path) -> None:
    done = run(
        "benchmarks/accuracy/normals", ball, "-n", 3000, "--noise", 0, 0.5, "--outliers", 0, 5
    )
    assert done.returncode == 0, done.stderr
    rows = [line.split("|")[1:-1] for line in done.stdout.splitlines()[2:]]
    clouds = [row for row in rows if row[0].startswith(" ball")]
    assert len(clouds) == 4
    assert all(float(row[1]) < float(row[4]) for row in clouds)  # better than planes
    assert [bool(row[7].strip()) for row in clouds] == [False, True, False, True]


def test_stages_of_normals_are_measured_one_by_one(run: Run, ball: Path) -> None:
    done = run("benchmarks/accuracy/normal_stages", ball, "-n", 1500, "--noise", 1, "--pairs", 20)
    assert done.returncode == 0, done.stderr
    errors = [float(line.split("|")[2]) for line in done.stdout.splitlines() if "| +" in line]
    assert len(errors) == 8
    assert errors[-1] < errors[0]
    assert "told the truth" in done.stdout


def test_flips_are_told_apart_by_thickness(run: Run, ball: Path) -> None:
    done = run(
        "benchmarks/accuracy/flips",
        ball,
        "-n",
        2000,
        "--noise",
        0,
        0.5,
        "--density",
        "uniform",
        "patchy",
    )
    assert done.returncode == 0, done.stderr
    rows = [line.split("|")[1:-1] for line in done.stdout.splitlines() if "| ball" in line]
    assert len(rows) == 4
    assert all(float(row[1]) < 0.1 and float(row[3]) == 0.0 for row in rows)
    assert done.stdout.splitlines()[-1].count(",") == 9


def test_topology_of_a_ball(run: Run, ball: Path) -> None:
    done = run("benchmarks/accuracy/topology", ball, "-n", 2000, "--noise", 0, 1)
    for line, noise in zip(done.stdout.splitlines()[2:], ["0", "1"], strict=True):
        assert line.startswith(f"| {ball.stem}, {noise} % | 1 | 1 | 0 | 0 | ")


def test_scans_are_measured_and_a_missing_one_loses_only_itself(
    run: Run, ball: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    done = run("scans", tmp_path / "missing.ply", ball, "--out", out)
    assert done.returncode == 1
    assert "missing.ply'" in done.stdout
    (row,) = read_csv(out / "scans.csv")
    vertices = len(o3d.io.read_triangle_mesh(str(ball)).vertices)
    assert (row["file"], row["points"], row["pieces"]) == ("ball.ply", str(vertices), "1")
    assert row["closed"] == "yes"
    assert 0.0 < float(row["distance"]) < 0.1  # percent of the diagonal
    assert f"| ball.ply | {vertices} | {float(row['seconds']):.1f} |" in done.stdout


def test_pieces_and_handles_that_the_truth_does_not_have(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(DEMOS / "benchmarks" / "accuracy"))
    from flips import Surface
    from topology import wrong_places

    shapes = [o3d.geometry.TriangleMesh.create_torus(1.0, 0.2, 60, 40)]
    shapes.append(o3d.geometry.TriangleMesh.create_sphere(0.5).translate((0.0, 0.0, 1.0)))
    (ring, turns), (ball, facets) = (
        (np.asarray(shape.vertices), np.asarray(shape.triangles)) for shape in shapes
    )
    assert list(wrong_places(ring, turns, Surface(ring, turns), 1, 0.05)) == []
    both = np.vstack([ring, ball]), np.vstack([turns, facets + len(ring)]).astype(np.int32)
    (_, stray), (what, loop) = wrong_places(*both, Surface(ball, facets), 1, 0.05)
    assert len(stray) == len(ball)
    assert what == "bridge"
    assert np.ptp(loop, axis=0).max() < 0.5  # around the ring, not along it


def test_rounding_costs_no_more_than_the_step_allows(run: Run) -> None:
    done = run("benchmarks/accuracy/quantised", "-n", 1000, "--only", "box")
    assert done.returncode == 0, done.stderr
    rows = [line.split("|")[1:-1] for line in done.stdout.splitlines()[2:]]
    assert [row[0].strip() for row in rows] == ["box-6"] * 8
    assert {row[-1].strip() for row in rows} == {"yes"}


def test_plates_and_near_sheets_are_oriented(run: Run) -> None:
    plates = run("benchmarks/accuracy/plates", "--counts", 1, 4, "-n", 600)
    assert plates.returncode == 0, plates.stderr
    rows = [line.split("|")[1:-1] for line in plates.stdout.splitlines()[2:]]
    assert [int(row[1]) for row in rows] == [600, 2400]
    assert max(float(row[2]) for row in rows) < 1.0
    sheets = run("benchmarks/accuracy/near_sheets", "-n", 1500, "--gaps", 1.5, "--seeds", 1)
    assert sheets.returncode == 0, sheets.stderr
    rows = [line.split("|")[1:-1] for line in sheets.stdout.splitlines()[2:]]
    assert len(rows) == 5
    assert max(float(row[3]) for row in rows if "nested" not in row[0]) < 1.0
