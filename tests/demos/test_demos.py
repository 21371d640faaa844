"""The demos run, in a folder of their own, and what they write is what they say."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from demo_runs import DEMOS, Run, run_demo
from mesh_checks import assert_valid_mesh
from report_page import read_csv

o3d = pytest.importorskip("open3d")
pytest.importorskip("pymeshlab")
pytest.importorskip("matplotlib")


@pytest.fixture
def run(tmp_path: Path) -> Run:
    return partial(run_demo, tmp_path)


def is_picture(file: Path) -> bool:
    from PIL import Image

    pixels = np.asarray(Image.open(file).convert("RGB"))
    return float(pixels.std()) > 5.0  # an empty window has one colour


def test_quickstart_writes_meshes_and_pictures(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run("quickstart", "--quick", "--out", out)
    assert result.returncode == 0, result.stdout + result.stderr
    assert result.stderr == ""
    for name in ("chameleon", "face", "bunny"):
        assert str(out / f"{name}.ply") in result.stdout
        assert is_picture(out / f"{name}.png")
    assert is_picture(out / "overview.png")
    assert (out / "overview.png").stat().st_size < 400_000
    for name in ("chameleon", "bunny"):
        assert_valid_mesh(o3d.io.read_triangle_mesh(str(out / f"{name}.ply")))
    sheet = o3d.io.read_triangle_mesh(str(out / "face.ply"))
    assert len(sheet.triangles) > 0
    assert o3d.io.read_triangle_mesh(str(out / "chameleon.ply")).has_vertex_colors()
    # Nothing half-written and no helper files stay behind.
    assert {file.suffix for file in out.iterdir()} == {".ply", ".png"}


def test_an_input_that_takes_too_long_loses_only_itself(run: Run, tmp_path: Path) -> None:
    result = run("quickstart", "--quick", "--out", tmp_path / "out", "--timeout", "0.01")
    assert result.returncode == 1
    assert result.stdout.count("failed: stopped after") == 3


def heed_interrupts() -> None:
    # A test run in the background of a shell ignores SIGINT, and its children inherit that.
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize(
    "name", ["quickstart", "gallery", "paper", "meshlab", "benchmarks/accuracy/orientation"]
)
def test_ctrl_c_ends_a_demo_quietly(name: str, tmp_path: Path) -> None:
    if sys.platform == "win32":
        pytest.skip("there is no SIGINT to send")
    folder = [] if name == "benchmarks/accuracy/orientation" else ["--out", tmp_path / "out"]
    with subprocess.Popen(
        [sys.executable, DEMOS / f"{name}.py", *folder],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
        text=True,
        start_new_session=True,
        preexec_fn=heed_interrupts,
    ) as process:
        assert process.stdout is not None
        first = process.stdout.read(1)
        time.sleep(0.5)
        os.killpg(process.pid, signal.SIGINT)
        output, _ = process.communicate(timeout=60)
    assert first
    assert process.returncode == 130, output
    assert "Traceback" not in output
    assert "interrupted" in output


def test_gallery_cases_have_unique_pictures_below_their_limit(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run("gallery", "--quick", "--out", out)
    assert result.returncode == 0, result.stdout + result.stderr
    files = sorted(out.glob("*.png"))
    assert len(files) == 8
    for file in files:
        assert file.stat().st_size < 120_000
        assert is_picture(file)
        assert f"docs/gallery/{file.name}" in result.stdout
    assert "reconstruct_surface(pcd, trim=" in result.stdout


def test_paper_writes_figures_and_consistent_tables(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run("paper", "--quick", "--out", out)
    assert result.returncode == 0, result.stdout + result.stderr
    for name in ("figure2", "figure3_incisor", "figure3_molar"):
        assert is_picture(out / f"{name}.png")
    for row in read_csv(out / "figure2.csv"):
        assert int(row["traditional"]) == 3 * int(row["points"])
        assert int(row["ours"]) == int(row["points"]) + int(row["offset_points"])
        share = 100 * int(row["offset_points"]) / int(row["points"])
        assert f"{row['offset_points']} offset points, {share:.1f} % of the points" in result.stdout
    table = (out / "table1.md").read_text(encoding="utf-8")
    rows = read_csv(out / "table1.csv")
    assert [row["model"] for row in rows] == ["incisor", "molar"]
    for row in rows:
        ours, theirs = float(row["ours_total_s"]), float(row["traditional_total_s"])
        assert float(row["time_ratio"]) == pytest.approx(ours / theirs, abs=1e-3)
        line = next(line for line in table.splitlines() if f"{row['model']}, here" in line)
        shown = [cell.strip() for cell in line.strip("|").split("|")][1:]
        assert shown[:4] == [
            row["points"],
            f"{theirs:.2f}",
            f"{ours:.2f}",
            f"{float(row['time_ratio']):.3f}",
        ]
        assert shown[4] == f"{3 * int(row['points'])}, {row['ours_with_offsets']}"
        for cell, key in zip(shown[5:7], ("median_error", "rms_error"), strict=True):
            pair = [float(row[f"{kind}_{key}"]) for kind in ("traditional", "ours")]
            assert cell == f"{pair[0]:.1e}, {pair[1]:.1e}"


def test_paper_takes_files_and_samples_a_mesh_with_few_vertices(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(DEMOS)
    import paper

    file = tmp_path / "ball.ply"
    o3d.io.write_triangle_mesh(str(file), o3d.geometry.TriangleMesh.create_sphere(1.0, 12))
    points = paper.Input("molar", file).points
    assert len(points) == max(paper.SIZES)
    assert np.linalg.norm(points, axis=1).max() <= 1.0 + 1e-12
    np.testing.assert_array_equal(points, paper.Input("molar", file).points)


def test_paper_says_when_blas_crashed_and_tries_one_thread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(DEMOS)
    import paper

    from o3d_sofnn.compare.isolated import Outcome

    def call(function: Any, *_: Any, environment: dict[str, str], **__: Any) -> Outcome:
        if function is paper.experiments.solution_seconds:
            return Outcome(2.0 if environment else 1.0, None, 1.0, None)
        return (
            Outcome("done", None, 1.0, None) if environment else Outcome(None, "crashed", 1, None)
        )

    monkeypatch.setattr(paper, "call", call)
    found = paper.Paper(tmp_path, True, 10.0)._variational(np.zeros((20, 3)), 1.0)
    assert found == "done"
    said = capsys.readouterr().out
    assert "failed with all threads of BLAS: crashed" in said
    assert "traditional method, 20 points, one thread: " in said


def test_compare_demo_takes_inputs_from_the_wheel(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    options = ("--quick", "--out", out, "--points", 800, "--sizes", "--methods")
    result = run("compare", *options, "open3d_alpha_shape", "meshlab_ball_pivoting")
    assert result.returncode == 0, result.stdout + result.stderr
    assert f"report {out / 'report.html'}" in result.stdout
    assert "PROGRESS 0" in result.stdout
    rows = read_csv(out / "results.csv")
    assert {row["input"] for row in rows} == {"chameleon", "bunny"}
    assert {row["noise"] for row in rows if row["input"] == "bunny"} == {"0.0", "1.0"}
    assert not any(row["error"] for row in rows)


def test_traditional_method_interpolates_its_centers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(DEMOS)
    from paper_parts import traditional

    rng = np.random.default_rng(0)
    centers = 1e3 + rng.normal(size=(200, 3))
    values = rng.normal(size=200)
    interpolant = traditional.interpolate(centers, values)
    np.testing.assert_allclose(interpolant(centers), values, atol=1e-8)
    # Linear functions are reproduced everywhere.
    slope = np.array([0.3, -1.0, 2.0])
    linear = traditional.interpolate(centers, centers @ slope)
    far = 1e3 + 5.0 * rng.normal(size=(50, 3))
    np.testing.assert_allclose(linear(far), far @ slope, rtol=1e-9)


def test_generated_teeth_lie_on_their_surface(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(DEMOS)
    from paper_parts import dental_shapes

    for tooth in (dental_shapes.incisor(), dental_shapes.molar()):
        points = tooth.sample(500)
        assert points.shape == (500, 3)
        assert np.abs(tooth.distance(points)).max() < 1e-4
        assert (np.abs(points) < tooth.half_size).all()
        np.testing.assert_array_equal(points, tooth.sample(500))
