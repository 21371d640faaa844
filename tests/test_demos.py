"""The demos run, in a folder of their own, and what they write is what they say."""

from __future__ import annotations

import csv
import html.parser
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pytest
from mesh_checks import assert_valid_mesh
from shapes import torus

o3d = pytest.importorskip("open3d")
pytest.importorskip("pymeshlab")
pytest.importorskip("pyvista")
pytest.importorskip("matplotlib")

DEMOS = Path(__file__).parent.parent / "demos"
SHARES = ("watertight", "manifold")

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def run(tmp_path: Path) -> Run:
    def run_demo(name: str, *arguments: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, DEMOS / f"{name}.py", *map(str, arguments)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )

    return run_demo


@pytest.fixture
def tiny_cloud(tmp_path: Path) -> Path:
    file = tmp_path / "ring.ply"
    points = o3d.utility.Vector3dVector(torus(1200).points)
    o3d.io.write_point_cloud(str(file), o3d.geometry.PointCloud(points))
    return file


@pytest.fixture
def tiny_mesh(tmp_path: Path) -> Path:
    file = tmp_path / "ball.ply"
    o3d.io.write_triangle_mesh(str(file), o3d.geometry.TriangleMesh.create_sphere(1.0, 12))
    return file


def read_csv(file: Path) -> list[dict[str, str]]:
    with file.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def is_picture(file: Path) -> bool:
    from PIL import Image

    pixels = np.asarray(Image.open(file).convert("RGB"))
    return float(pixels.std()) > 5.0  # an empty window has one colour


def test_quickstart_writes_meshes_and_pictures(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run("quickstart", "--quick", "--output", out)
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
    result = run("quickstart", "--quick", "--output", tmp_path / "out", "--timeout", "0.01")
    assert result.returncode == 1
    assert result.stdout.count("failed: stopped after") == 3


def heed_interrupts() -> None:
    # A test run in the background of a shell ignores SIGINT, and its children inherit that.
    signal.signal(signal.SIGINT, signal.SIG_DFL)


def test_ctrl_c_ends_a_demo_quietly(tmp_path: Path) -> None:
    if sys.platform == "win32":
        pytest.skip("there is no SIGINT to send")
    with subprocess.Popen(
        [sys.executable, DEMOS / "quickstart.py", "--output", tmp_path / "out"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed_interrupts,
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(0.5)
        os.killpg(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert "interrupted" in errors


def test_gallery_cases_have_unique_pictures_below_their_limit(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = run("gallery", "--quick", "--output", out)
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
    result = run("paper", "--quick", "--output", out)
    assert result.returncode == 0, result.stdout + result.stderr
    for name in ("figure2", "figure3_incisor", "figure3_molar"):
        assert is_picture(out / f"{name}.png")
    for row in read_csv(out / "figure2.csv"):
        assert int(row["traditional"]) == 3 * int(row["points"])
        assert int(row["ours"]) == int(row["points"]) + int(row["offset_points"])
    table = (out / "table1.md").read_text(encoding="utf-8")
    rows = read_csv(out / "table1.csv")
    assert [row["model"] for row in rows] == ["incisor", "molar"]
    for row in rows:
        ours, theirs = float(row["ours_total_s"]), float(row["traditional_total_s"])
        assert float(row["time_ratio"]) == pytest.approx(ours / theirs, rel=0.01, abs=1e-3)
        assert f"| {float(row['time_ratio']):.3f} |" in table


def test_traditional_method_interpolates_its_centers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(DEMOS)
    import traditional

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
    import dental_shapes

    for tooth in (dental_shapes.incisor(), dental_shapes.molar()):
        points = tooth.sample(500)
        assert points.shape == (500, 3)
        assert np.abs(tooth.distance(points)).max() < 1e-4
        assert (np.abs(points) < tooth.half_size).all()
        np.testing.assert_array_equal(points, tooth.sample(500))


class Tables(html.parser.HTMLParser):
    """The rows of the report's tables: a list of data-value, or the text of a failure."""

    def __init__(self) -> None:
        super().__init__()
        self.rows: dict[str, list[list[str]]] = {}
        self.titles: dict[str, list[str]] = {}
        self._table = ""
        self._in_title = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        if tag == "table":
            self._table = values["id"] or ""
            self.rows[self._table], self.titles[self._table] = [], []
        elif tag == "tr":
            self.rows[self._table].append([])
        elif tag == "td":
            self.rows[self._table][-1].append(values.get("data-value") or "")
        self._in_title = tag == "button"

    def handle_data(self, data: str) -> None:
        if self._in_title:
            self.titles[self._table].append(data)
            self._in_title = False


def test_compare_report_shows_the_csv(
    run: Run, tmp_path: Path, tiny_cloud: Path, tiny_mesh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(DEMOS)
    from measure import FIGURES

    out = tmp_path / "out"
    methods = ("ours", "open3d_poisson", "open3d_alpha_shape")
    options = ("--quick", "--points", 1500, "--out", out, "--methods", *methods)
    result = run("compare", tiny_cloud, tmp_path / "missing.ply", *options, "--truth", tiny_mesh)
    assert result.returncode == 1, result.stdout + result.stderr  # one input was missing
    rows = read_csv(out / "results.csv")
    assert len(rows) == 4 * len(methods)
    by_name = {(row["input"], row["method"]): row for row in rows}
    assert "not read" in by_name["missing", "ours"]["error"]
    ours = by_name["ring", "ours"]
    assert (float(ours["watertight"]), float(ours["components"])) == (1.0, 1.0)
    assert float(by_name["ball_noise_0", "ours"]["flipped"]) == 0.0
    assert float(by_name["ball_noise_0", "ours"]["chamfer"]) < 10.0
    for name in ("ring", "ball_noise_0", "ball_noise_0.5"):
        assert is_picture(out / f"{name}.png")

    text = (out / "report.html").read_text(encoding="utf-8")
    assert "://" not in text  # it opens offline
    tables = Tables()
    tables.feed(text)
    names = {title: key for key, title in FIGURES.items()}
    columns = [names.get(title, title) for title in tables.titles["results"]]
    for shown, row in zip(tables.rows["results"][1:], rows, strict=True):
        expected = [row["input"], row["method"]] if row["error"] else [row[c] for c in columns]
        assert [value for value in shown if value] == [value for value in expected if value]

    columns = [names.get(title, title) for title in tables.titles["summary"]]
    for shown in tables.rows["summary"][1:]:
        good = [row for row in rows if row["method"] == shown[0] and not row["error"]]
        for column, value in zip(columns[1:-1], shown[1:-1], strict=True):
            found = [float(row[column]) for row in good if row[column]]
            if not found:
                assert value == ""
                continue
            middle = sum(found) / len(found) if column in SHARES else median(found)
            assert float(value) == pytest.approx(middle)
        assert int(shown[-1]) == len(good)
