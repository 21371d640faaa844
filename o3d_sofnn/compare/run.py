"""The whole comparison: all inputs, all methods; figures and report are updated on the way."""

from __future__ import annotations

import contextlib
import csv
import io
import platform
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import scipy

import o3d_sofnn
from o3d_sofnn import adapters
from o3d_sofnn.compare import cases, report
from o3d_sofnn.compare.cases import Case, Ladder, Source
from o3d_sofnn.compare.evaluate import METHODS, Evaluation, Look, before, evaluate
from o3d_sofnn.compare.isolated import call
from o3d_sofnn.compare.measure import FIGURES
from o3d_sofnn.compare.scene import Scene
from o3d_sofnn.progress import NoProgress, ProgressCallback, rescale
from o3d_sofnn.threads import thread_count

Row = dict[str, Any]

COLUMNS = ("input", "points", "noise", "method", "error", *FIGURES)
"""Columns of the CSV file."""
FORMULA = ("=", "+", "-", "@", "\t", "\r", "\n")
"""First characters of formulas in spreadsheets, possibly after blanks, which these strip."""
SAMPLES = 50_000
QUICK_SAMPLES = 10_000
"""Number of points drawn from each surface for the comparison with the truth."""
PATIENT = {"OMP_WAIT_POLICY": "PASSIVE"}
"""OpenMP threads that wait at a barrier sleep: on a busy machine, spinning would delay others."""
ALL_TRIANGLES = 600_000
FEWEST_TRIANGLES, MOST_TRIANGLES = 4_000, 30_000
"""Triangles in all panes of a report, and in one pane: gives a file of about ten megabytes."""


@dataclass
class Result:
    """The results so far.

    Attributes
    ----------
    rows : list of dict
        One row per method and cloud, with the keys ``COLUMNS``; "" or None if there is no figure.
    scenes : list of Scene
        One scene per cloud.
    report : Path
        The HTML page.
    """

    rows: list[Row] = field(default_factory=list)
    scenes: list[Scene] = field(default_factory=list)
    report: Path = Path()


def run(
    inputs: Sequence[Source],
    output: Path,
    *,
    methods: Sequence[str] = tuple(METHODS),
    ladder: Ladder | None = None,
    timeout: float = 180.0,
    quick: bool = False,
    progress: ProgressCallback | None = None,
) -> Result:
    """Run all methods on all inputs, and write ``results.csv``, pictures and ``report.html``.

    Parameters
    ----------
    inputs : sequence of Source
        Scans and models.
    output : Path
        A folder; it is created if it is missing.
    methods : sequence of str
        Some of ``METHODS``.
    ladder : Ladder, optional
        Numbers of points, and noise.
    timeout : float, default 180
        Seconds for one method on one cloud, including the measurements.
    quick : bool, default False
        Whether figures are coarser.
    progress : callable, optional
        Called with the fraction done and the current stage.

    Returns
    -------
    Result
        A failure of a method is a row with an ``error``; an unreadable input is one without a
        method.

    Raises
    ------
    KeyboardInterrupt
        After Ctrl-C; the report on the finished part has been written.
    """
    output.mkdir(parents=True, exist_ok=True)
    progress = progress or NoProgress()
    ladder = ladder or Ladder()
    result = Result(report=output / "report.html")
    steps = sum(cases.count(source, ladder) for source in inputs) * len(methods)
    job = _Job(
        output,
        tuple(methods),
        timeout,
        QUICK_SAMPLES if quick else SAMPLES,
        min(max(ALL_TRIANGLES // max(steps, 1), FEWEST_TRIANGLES), MOST_TRIANGLES),
    )
    note = ""
    try:
        done = 0
        for source in inputs:
            whole = cases.count(source, ladder) * len(methods)
            for number, case in enumerate(_read(source, ladder, result)):
                base = done + number * len(methods)
                share = rescale(progress, base / steps, (base + len(methods)) / steps)
                _compare(case, job, result, share)
            done += whole
    except KeyboardInterrupt:
        note = "Interrupted: only the finished part is shown."
        raise
    finally:
        if result.rows:
            _write_csv(output / "results.csv", result.rows)
            report.write(result.report, result.rows, result.scenes, note, machine())
    return result


@dataclass(frozen=True)
class _Job:
    output: Path
    methods: tuple[str, ...]
    timeout: float
    samples: int
    triangles: int


def _read(source: Source, ladder: Ladder, result: Result) -> Iterator[Case]:
    try:
        yield from cases.cases(source, ladder)
    except (OSError, ValueError, ImportError, RuntimeError) as error:
        message = f"not read: {' '.join(str(error).split())}"
        result.rows.append(_row(source.name, None, None, "", message))


def _compare(case: Case, job: _Job, result: Result, progress: ProgressCallback) -> None:
    scene = Scene(case.title, case.view)
    result.scenes.append(scene)
    progress(0.0, case.title)
    first = call(before, case, timeout=job.timeout)
    if first.error is None:
        scene.looks["input"] = first.value
        _write_pictures(case, "input", first.value, job.output)
    for k, method in enumerate(job.methods):
        progress(k / len(job.methods), f"{case.title}: {method}")
        outcome = call(
            evaluate,
            case,
            method,
            job.samples,
            job.triangles,
            timeout=job.timeout,
            environment=PATIENT,
        )
        row = _row(case.input, len(case.points), case.noise, method, outcome.error or "")
        found: Evaluation | None = outcome.value
        if found is not None:
            row |= found.figures
            _write_pictures(case, method, found.look, job.output)
        result.rows.append(row)
        scene.add(row, None if found is None else found.look)
        _write_csv(job.output / "results.csv", result.rows)


def machine() -> str:
    """Return what the methods run with, and on what: packages with versions, system, processor."""
    packages = {
        "o3d_sofnn": o3d_sofnn.__version__,
        "Python": platform.python_version(),
        "NumPy": np.__version__,
        "SciPy": scipy.__version__,
        "Open3D": adapters.import_open3d().__version__,
    }
    with contextlib.suppress(PackageNotFoundError):  # its methods say that it is missing
        packages["PyMeshLab"] = version("pymeshlab")
    named = ", ".join(f"{name} {number}" for name, number in packages.items())
    place = f"{platform.system()}, {_processor()}, {thread_count()} threads"
    return f"{named}; {place}."


def _processor() -> str:
    """Return the name of the processor where the system tells it, else of its kind."""
    told = Path("/proc/cpuinfo")
    if told.exists():
        found = re.search(r"model name\s*:\s*(.+)", told.read_text(errors="replace"))
        if found:
            return found[1].strip()
    if sys.platform == "darwin":
        asked = ["/usr/sbin/sysctl", "-n", "machdep.cpu.brand_string"]
        done = subprocess.run(asked, capture_output=True, text=True, check=False)
        if done.returncode == 0:
            return done.stdout.strip()
    return platform.processor() or platform.machine()


def _row(name: str, points: int | None, noise: float | None, method: str, error: str) -> Row:
    return {"input": name, "points": points, "noise": noise, "method": method, "error": error}


def _write_pictures(case: Case, method: str, look: Look, output: Path) -> None:
    for kind, data in look.pictures.items():
        suffix = "" if kind == "surface" else f"-{kind}"
        report.save(output / f"{case.name}-{method}{suffix}.png", data)


def _write_csv(path: Path, rows: list[Row]) -> None:
    stream = io.StringIO(newline="")
    writer = csv.DictWriter(stream, COLUMNS)
    writer.writeheader()
    writer.writerows({key: _plain(value) for key, value in row.items()} for row in rows)
    report.save(path, stream.getvalue())


def _plain(value: Any) -> Any:
    """Escape text that a spreadsheet would run as a formula."""
    return f"'{value}" if isinstance(value, str) and value.startswith(FORMULA) else value
