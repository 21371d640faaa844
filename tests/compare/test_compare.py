"""``o3d-sofnn compare``: every figure of the report comes out of the CSV file."""

from __future__ import annotations

import errno
import os
import platform
import re
import signal
import subprocess
import sys
import time
from collections import defaultdict
from pathlib import Path
from statistics import median

import numpy as np
import pytest
import shapes
from report_page import Page, read_csv

from o3d_sofnn.cli import main
from o3d_sofnn.compare import cases, isolated, report, run
from o3d_sofnn.compare.measure import FIGURES

o3d = pytest.importorskip("open3d")

METHODS = ("ours", "open3d_poisson", "open3d_alpha_shape")
YES_OR_NO = ("watertight", "manifold")


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A scan, a closed mesh, a cloud without a volume, and a file that is not there."""
    folder = tmp_path_factory.mktemp("inputs")
    np.savetxt(folder / "ring.xyz", shapes.torus(900).points)
    ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 12)
    o3d.io.write_triangle_mesh(str(folder / "ball.ply"), ball)
    flat = np.random.default_rng(0).random((100, 3)) * [1.0, 0.0, 0.0]
    np.savetxt(folder / "flat.xyz", flat)
    return [folder / name for name in ("ring.xyz", "ball.ply", "flat.xyz", "missing.ply")]


@pytest.fixture(scope="module")
def compared(
    inputs: list[Path], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, list[dict[str, str]], Page]:
    """The folder, the rows of the CSV file, and the page."""
    out = tmp_path_factory.mktemp("compared")
    small = ["--quick", "--points", "900", "--sizes", "400", "--noise", "0", "1"]
    arguments = [*map(str, inputs), "--out", str(out), *small, "--methods", *METHODS]
    assert main.main(["compare", *arguments]) == 1  # a file was missing
    return out, read_csv(out / "results.csv"), Page(out / "report.html")


def number(text: str) -> float | None:
    return float(text) if text else None


def good(rows: list[dict[str, str]]) -> list[dict[str, str]]:
    return [row for row in rows if not row["error"]]


def test_every_input_and_method_has_a_row(compared):
    _, rows, _ = compared
    clouds = defaultdict(list)
    for row in rows:
        clouds[row["input"], row["points"], row["noise"]].append(row["method"])
    whole = list(METHODS)
    assert clouds == {
        ("ring", "900", ""): whole,
        ("ring", "400", ""): whole,
        ("ball", "900", "0.0"): whole,
        ("ball", "900", "1.0"): whole,
        ("ball", "400", "0.0"): whole,
        ("flat", "100", ""): whole,
        ("missing", "", ""): [""],
    }


def test_failures_keep_their_message_and_the_others_go_on(compared):
    _, rows, _ = compared
    by_name = {(row["input"], row["points"], row["method"]): row for row in rows}
    assert "lie on one line" in by_name["flat", "100", "ours"]["error"]
    assert "not read" in by_name["missing", "", ""]["error"]
    assert float(by_name["ring", "900", "ours"]["watertight"]) == 1.0
    assert float(by_name["ball", "900", "ours"]["chamfer"]) < 20.0
    assert float(by_name["ball", "400", "ours"]["flipped"]) == 0.0
    assert by_name["ring", "900", "ours"]["chamfer"] == ""  # its truth is not known


def test_tables_show_the_csv(compared):
    _, rows, page = compared
    columns = page.titles["results"]
    whole = [cells for cells in page.rows["results"][1:] if not cells[0][1].endswith(report.TURNED)]
    for cells, row in zip(whole, rows, strict=True):
        shown = dict(zip(columns, cells, strict=False))
        for key, (value, text) in shown.items():
            if value is None:
                assert text == f"failed: {row['error']}"
                continue
            assert value == row[key] or float(value) == float(row[key])
            if key in FIGURES and value and key not in YES_OR_NO:
                assert float(text.replace(",", "")) == pytest.approx(
                    float(value), rel=0.01, abs=0.5
                )
        assert row["error"] or len(shown) == len(columns)


def test_the_summary_has_the_medians_of_the_csv(compared):
    _, rows, page = compared
    columns = page.titles["summary"]
    lines = [
        {key: value for key, (value, _) in zip(columns, cells, strict=False)}
        for cells in page.rows["summary"][1:]
        if not cells[0][1].endswith(report.TURNED)
    ]
    assert [line["method"] for line in lines] == list(METHODS)
    for line in lines:
        own = [row for row in rows if row["method"] == line["method"]]
        assert int(line["runs"]) == len(own)
        assert int(line["failed"]) == len(own) - len(good(own))
        for key in columns[3:]:
            values = [float(row[key]) for row in good(own) if row[key]]
            middle = np.mean if key in YES_OR_NO else median
            expected = middle(values) if values else None
            assert number(line[key] or "") == pytest.approx(expected)


def test_the_page_says_what_ran_and_where(compared):
    out, _, _ = compared
    text = (out / "report.html").read_text(encoding="utf-8")
    for name, version in (("Python", platform.python_version()), ("Open3D", o3d.__version__)):
        assert f"{name} {version}" in text
    assert f"NumPy {np.__version__}" in text
    assert re.search(r"; \w+, [^;<]+, \d+ threads\.</p>", text)


def test_charts_show_medians_of_the_csv(compared):
    out, rows, page = compared
    assert set(page.points) == {"error-noise", "flipped-noise", "time-size"}
    for name, x, y in (
        ("error-noise", "noise", "chamfer"),
        ("flipped-noise", "noise", "flipped"),
        ("time-size", "points", "seconds"),
    ):
        sizes = defaultdict(set)
        for row in good(rows):
            if row["noise"] in ("", "0.0"):
                sizes[row["input"]].add(row["points"])
        most_sizes = max(sizes, key=lambda name: len(sizes[name]))
        expected = defaultdict(list)
        for row in good(rows):
            counts = row["points"] == "900" if x == "noise" else row["noise"] in ("", "0.0")
            if x == "points":
                counts = counts and row["input"] == most_sizes
            if counts and row[x] and row[y]:
                expected[row["method"], float(row[x])].append(float(row[y]))
        drawn = {
            (point["data-method"], float(point["data-x"])): float(point["data-y"])
            for point in page.points[name]
        }
        assert drawn == {key: pytest.approx(median(values)) for key, values in expected.items()}
        assert (out / f"{name}.svg").read_text(encoding="utf-8").startswith("<svg xmlns=")


def test_panes_show_the_csv(compared):
    out, rows, page = compared
    by_name = {(row["input"], row["points"], row["noise"], row["method"]): row for row in rows}
    assert len(page.data["scenes"]) == 6
    for scene in page.data["scenes"]:
        found = re.fullmatch(r"(\w+), ([\d,]+) points(?:, ([\d.]+) % noise)?", scene["title"])
        assert found is not None
        noise = "" if found[3] is None else str(float(found[3]))
        assert [pane["method"] for pane in scene["panes"]] == ["input", *METHODS]
        for pane in scene["panes"][1:]:
            row = by_name[found[1], found[2].replace(",", ""), noise, pane["method"]]
            if row["error"]:
                assert pane["error"] == row["error"]
                continue
            key = "chamfer" if row["chamfer"] else "input_mean"
            fact = re.fullmatch(rf"([\d.e-]+) s, {FIGURES[key]} ([\d.e-]+)", pane["facts"])
            assert fact is not None, pane["facts"]
            assert float(fact[1]) == pytest.approx(float(row["seconds"]), rel=0.01)
            assert float(fact[2]) == pytest.approx(float(row[key]), rel=0.01)
            assert set(pane["pictures"]) >= {"surface"}
    assert (out / "ball-900-noise-1-ours-flipped.png").read_bytes()[:4] == b"\x89PNG"


def test_the_page_needs_nothing_from_outside(compared):
    out, _, _ = compared
    text = (out / "report.html").read_text(encoding="utf-8")
    assert "://" not in text
    assert "{{" not in text
    assert "Content-Security-Policy" in text
    assert not re.search(r"(src|href)=\"(?!data:)", text)


def test_ctrl_c_leaves_a_report_on_what_was_finished(inputs, tmp_path, monkeypatch):
    calls = []

    def interrupt(function, *args, **options):
        calls.append(args)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return isolated.call(function, *args, **options)

    monkeypatch.setattr(run, "call", interrupt)
    options = ["--out", str(tmp_path), "--quick", "--methods", "open3d_alpha_shape", "ours"]
    assert main.main(["compare", str(inputs[0]), *options]) == main.INTERRUPTED
    assert [row["method"] for row in read_csv(tmp_path / "results.csv")] == ["open3d_alpha_shape"]
    assert "Interrupted" in (tmp_path / "report.html").read_text(encoding="utf-8")


def spawned(process: int) -> list[Path]:
    """Processes that multiprocessing has started, without its own helper."""
    tasks = Path(f"/proc/{process}/task").glob("*/children")
    found = [Path(f"/proc/{child}") for task in tasks for child in task.read_text().split()]
    return [child for child in found if b"spawn_main" in (child / "cmdline").read_bytes()]


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="Linux tells the children")
def test_sigterm_ends_the_process_of_a_method_too(tmp_path):
    np.savetxt(tmp_path / "ring.xyz", shapes.torus(50_000).points)
    options = ["--out", str(tmp_path / "out"), "--methods", "ours", "--progress", "plain"]
    with subprocess.Popen(
        [sys.executable, "-m", "o3d_sofnn", "compare", str(tmp_path / "ring.xyz"), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
    ) as process:
        for line in process.stdout:
            if "ours" in line:
                break
        while not (started := spawned(process.pid)):
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGTERM, err
    assert "interrupted" in err
    assert not list(tmp_path.rglob("*.part"))
    assert not any(child.exists() for child in started)


def test_a_method_that_takes_too_long_is_a_failure_with_a_message(inputs, tmp_path):
    options = ["--out", str(tmp_path), "--quick", "--methods", "open3d_alpha_shape"]
    code = main.main(["compare", str(inputs[0]), *options, "--sizes", "--timeout", "0.01"])
    assert code == 0  # ours did not fail
    (row,) = read_csv(tmp_path / "results.csv")
    assert row["error"].startswith("stopped after")


def test_a_full_disk_is_said_with_the_name_of_the_file(tmp_path, capfd, monkeypatch):
    def full(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    out = tmp_path / "out"
    assert main.main(["compare", str(tmp_path / "none.ply"), "--out", str(out)]) == main.FAILURE
    message = f"o3d-sofnn: error: {out / 'results.csv'}: No space left on device\n"
    assert capfd.readouterr() == ("", message)
    assert list(out.iterdir()) == []
    case = cases.Case("ring", shapes.torus(100).points)
    with pytest.raises(OSError, match="No space left") as caught:
        run._write_pictures(case, "ours", two_pictures(), out)
    assert caught.value.filename == str(out / "ring-100-ours.png")
    with pytest.raises(OSError, match="No space left") as caught:
        report.write(out / "report.html", [], [])
    assert caught.value.filename == str(out / "report.html")
    assert list(out.iterdir()) == []


def two_pictures():
    return run.Look(*(np.zeros((0, 3)),) * 3, None, None, {"surface": b"1", "flipped": b"2"})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--methods", "nonsense"], "--methods: expected some of ours"),
        (["--noise", "-1"], "expected 0 to 100"),
        (["--points", "2"], "expected at least 4"),
        (["--timeout", "0"], "expected a positive number"),
    ],
)
def test_bad_options_are_one_line_and_code_2(inputs, tmp_path, capfd, options, message):
    arguments = ["compare", str(inputs[0]), "--out", str(tmp_path), *options]
    try:
        code = main.main(arguments)
    except SystemExit as stop:
        code = stop.code
    assert code == main.BAD_INPUT
    err = capfd.readouterr().err
    assert message in err
    assert err.count("\n") == 1
