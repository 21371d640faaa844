"""Compare inside MeshLab: its own surface reconstructions and ours, all by ``ms.apply_filter``.

Closed meshes are sampled, with and without noise, and every result is measured against them. The
peers get MeshLab's own normals first. Without arguments the meshes come from the pymeshlab wheel.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import demo
import inputs
from meshlab_sofnn import peers as chains

from o3d_sofnn.compare.isolated import call
from o3d_sofnn.compare.measure import FIGURES, Truth, figures
from o3d_sofnn.compare.peers import Array
from o3d_sofnn.geometry import mesh_properties

NOISE = (0.0, 0.005)
"""Noise of the points along each axis, as a fraction of the diagonal."""
MODELS = ("bunny", "cow", "bone")
"""Models of the wheel that are compared without arguments."""
SAMPLES = 50_000
"""Number of points drawn from each surface to measure their distance."""
PATIENT = {"OMP_WAIT_POLICY": "PASSIVE"}
"""OpenMP threads that wait at a barrier sleep: on a busy machine, spinning would delay others."""

TITLES = {
    "meshlab_sofnn": "ours",
    "meshlab_sofnn_poisson": "our normals, screened Poisson",
    "meshlab_poisson": "screened Poisson",
    "meshlab_ball_pivoting": "ball pivoting",
    "meshlab_rimls": "RIMLS",
    "meshlab_apss": "APSS",
}
"""Titles of the chains of filters."""
COLUMNS = ("input", "method", "error", *FIGURES, "normals_seconds")
"""Columns of the CSV file: those of ``o3d-sofnn compare``, and the time for normals."""
SHOWN = ("chamfer", "hausdorff", "normal_consistency", "flipped")
COUNTED = ("components", "triangles")


def main() -> int:
    """Compare and return the exit code, see :func:`demo.work`."""
    args = _arguments()
    comparison = Comparison(
        args.out.resolve(),
        args.methods,
        min(args.points, 4000) if args.quick else args.points,
        SAMPLES // 10 if args.quick else SAMPLES,
        args.timeout,
    )
    files = [*map(str, args.truth)] or [inputs.MODELS[name][0] for name in MODELS]
    jobs = {file: partial(comparison.run, file) for file in files}
    return demo.work(jobs, comparison.output, comparison.finish)


@dataclass
class Comparison:
    """The inputs of the comparison, and the results so far."""

    output: Path
    methods: Sequence[str]
    points: int
    samples: int
    timeout: float
    rows: list[dict[str, Any]] = field(default_factory=list)

    def run(self, file: str) -> None:
        """Run all methods on the clouds of one model.

        Raises
        ------
        RuntimeError
            This package failed.
        """
        failures = []
        for name, cloud, truth in _clouds(file, self.points):
            for method in self.methods:
                print(f"  {name}: {method} ... ", end="", flush=True)
                row = _run(cloud, truth, method, self.samples, self.timeout)
                self.rows.append({"input": name, "method": method, **row})
                print(row["error"] or f"{row['seconds']:.2f} s", flush=True)
                demo.write_csv(self.output / "meshlab.csv", self.rows, COLUMNS)
                if row["error"] and method == "meshlab_sofnn":
                    failures.append(f"{name}: {row['error']}")
        if failures:
            raise RuntimeError("; ".join(failures))

    def finish(self) -> None:
        """Write and print the table."""
        table = "\n".join(_table(self.rows))
        (self.output / "meshlab.md").write_text(table + "\n", encoding="utf-8")
        print(f"\n{table}\n")


def _clouds(file: str, count: int) -> Iterator[tuple[str, Array, Truth]]:
    """Yield names, points and the true surface of a file, or of a model of the wheel."""
    vertices, triangles, _ = inputs.read_model(file)
    if not mesh_properties.is_closed(triangles):
        raise ValueError(f"{file}: expected a closed mesh")
    if mesh_properties.signed_volume(vertices, triangles) < 0:
        triangles = triangles[:, ::-1].copy()
    points, normals = mesh_properties.sample_surface(vertices, triangles, count)
    cloud = inputs.Cloud(Path(file).stem, points)
    for noise in NOISE:
        noisy = inputs.with_noise(cloud, noise)
        yield f"{cloud.name}, {100 * noise:g} %", noisy.points, Truth(vertices, triangles, normals)


def _run(points: Array, truth: Truth, method: str, count: int, timeout: float) -> dict[str, Any]:
    """Return a row of the table; a failure is a row with its message."""
    outcome = call(chains.run, points, method, timeout=timeout, environment=PATIENT)
    if outcome.error:
        return {"error": outcome.error}
    mesh, normals_seconds, seconds = outcome.value
    measured = call(figures, points, mesh, truth, count, timeout=timeout)
    if measured.error:
        return {"error": f"not measured: {measured.error}"}
    return {
        "error": "",
        "seconds": seconds,
        "normals_seconds": normals_seconds,
        "peak_mb": outcome.peak_mb,
        **measured.value,
    }


def _table(rows: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the lines of a Markdown table; the medians of each method come last."""
    titles = [FIGURES[key] for key in (*SHOWN, *COUNTED)]
    head = ["input", "method", "seconds (of these normals)", "closed, manifold", *titles]
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    methods = list(dict.fromkeys(row["method"] for row in rows))
    for row in [*rows, *(_median(rows, method) for method in methods)]:
        cells = [row["input"], TITLES[row["method"]]]
        if row["error"]:
            cells += [row["error"]]
        else:
            cells.append(f"{row['seconds']:.2f} ({row['normals_seconds']:.2f})")
            cells.append(", ".join(_share(row[key]) for key in ("watertight", "manifold")))
            cells += [f"{row[key]:.3g}" if key in row else "" for key in SHOWN]
            cells += [f"{row[key]:.0f}" for key in COUNTED]
        yield "| " + " | ".join(cells) + " |"


def _median(rows: list[dict[str, Any]], method: str) -> dict[str, Any]:
    good = [row for row in rows if row["method"] == method and not row["error"]]
    line: dict[str, Any] = {"input": f"median of {len(good)}", "method": method, "error": ""}
    if not good:
        return {**line, "error": "failed on every input"}
    for key in (*FIGURES, "normals_seconds"):
        values = [row[key] for row in good if row.get(key) is not None]
        if values:
            yes_or_no = key in ("watertight", "manifold")
            line[key] = sum(values) / len(values) if yes_or_no else median(values)
    return line


def _share(value: float) -> str:
    return {0.0: "no", 1.0: "yes"}.get(value, f"{100 * value:.0f} %")


def _arguments() -> argparse.Namespace:
    parser = demo.parser(__doc__, "meshlab", timeout=180.0)
    parser.add_argument(
        "truth", nargs="*", type=lambda text: Path(text).resolve(), help="closed meshes to sample"
    )
    parser.add_argument("--methods", nargs="+", choices=list(TITLES), default=list(TITLES))
    parser.add_argument("--points", type=int, default=20_000, help="drawn from each mesh")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
