"""Compare inside MeshLab: its own surface reconstructions and ours, all by ``ms.apply_filter``.

Closed meshes are sampled, with and without noise, and every result is measured against them. The
peers get MeshLab's own normals first. Without arguments the meshes come from the pymeshlab wheel.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import inputs
from meshlab_sofnn import peers as chains

from o3d_sofnn import metrics
from o3d_sofnn.compare.isolated import call
from o3d_sofnn.compare.measure import FIGURES, Truth, figures
from o3d_sofnn.compare.peers import Array

HERE = Path(__file__).parent
NOISE = (0.0, 0.005)
"""Of the points, along each axis, in parts of the diagonal."""
MODELS = ("bunny", "cow", "bone")
"""Of the wheel, compared without arguments."""
SAMPLES = 50_000
"""Points drawn from each surface to measure their distance."""
PATIENT = {"OMP_WAIT_POLICY": "PASSIVE"}
"""Threads of OpenMP that wait at a barrier sleep: on a busy machine they would delay each other."""

TITLES = {
    "meshlab_sofnn": "ours",
    "meshlab_sofnn_poisson": "our normals, screened Poisson",
    "meshlab_poisson": "screened Poisson",
    "meshlab_ball_pivoting": "ball pivoting",
    "meshlab_rimls": "RIMLS",
    "meshlab_apss": "APSS",
}
"""Of the chains of filters."""
SHOWN = ("chamfer", "hausdorff", "normal_consistency", "flipped")
COUNTED = ("components", "triangles")


def main() -> int:
    """Compare; 0 when this package succeeded on every input, 1 when not."""
    args = _arguments()
    output = args.out.resolve()
    output.mkdir(parents=True, exist_ok=True)
    count = SAMPLES // 10 if args.quick else SAMPLES
    rows: list[dict[str, Any]] = []
    points = min(args.points, 4000) if args.quick else args.points
    failed = interrupted = False
    try:
        for file in map(str, args.truth or [inputs.MODELS[name][0] for name in MODELS]):
            try:
                for name, cloud, truth in _clouds(file, points):
                    for method in args.methods:
                        print(f"{name}: {method} ... ", end="", flush=True)
                        row = _run(cloud, truth, method, count, args.timeout)
                        rows.append({"input": name, "method": method, **row})
                        print(row["error"] or f"{row['seconds']:.2f} s", flush=True)
                        _write_csv(output / "meshlab.csv", rows)
            except (OSError, ValueError, RuntimeError) as error:  # the other inputs go on
                failed = True
                print(f"failed: {file}: {error}", flush=True)
    except KeyboardInterrupt:
        interrupted = True
        print("\ninterrupted; this is what was finished", file=sys.stderr)
    table = "\n".join(_table(rows))
    (output / "meshlab.md").write_text(table + "\n", encoding="utf-8")
    print(f"\n{table}\n\n{output / 'meshlab.csv'}\n{output / 'meshlab.md'}")
    if interrupted:
        return 130
    return int(failed or any(row["error"] for row in rows if row["method"] == "meshlab_sofnn"))


def _clouds(file: str, count: int) -> Iterator[tuple[str, Array, Truth]]:
    """Yield names, points and the true surface; a whole path, or a model of the wheel."""
    vertices, triangles, _ = inputs.read_model(file)
    if not metrics.is_closed(triangles):
        raise ValueError("expected a closed mesh")
    if metrics.signed_volume(vertices, triangles) < 0:
        triangles = triangles[:, ::-1].copy()
    points, normals = metrics.sample_surface(vertices, triangles, count)
    cloud = inputs.Cloud(Path(file).stem, points)
    for noise in NOISE:
        noisy = inputs.with_noise(cloud, noise)
        yield f"{cloud.name}, {100 * noise:g} %", noisy.points, Truth(vertices, triangles, normals)


def _run(points: Array, truth: Truth, method: str, count: int, timeout: float) -> dict[str, Any]:
    """Return a row of the table; what fails becomes one with its message."""
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


def _write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write the columns of compare.py's results, and the time for normals."""
    columns = ["input", "method", "error", *FIGURES, "normals_seconds"]
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, columns)
        writer.writeheader()
        writer.writerows(rows)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "truth", nargs="*", type=lambda text: Path(text).resolve(), help="closed meshes to sample"
    )
    parser.add_argument("--methods", nargs="+", choices=list(TITLES), default=list(TITLES))
    parser.add_argument("--points", type=int, default=20_000, help="drawn from each mesh")
    parser.add_argument(
        "--out",
        type=Path,
        default=HERE / "output" / "meshlab",
        help="folder for the CSV and the table (default: %(default)s)",
    )
    parser.add_argument("--quick", action="store_true", help="fewer points, coarser figures")
    parser.add_argument(
        "--timeout", type=float, default=180.0, help="seconds for one method (default: %(default)g)"
    )
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
