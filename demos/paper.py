"""Section 5 of the paper, again: Figure 2, Figure 3 and Table 1, with tables "paper / here".

Without arguments the inputs are two crowns from ``dental_shapes``; any two point clouds can be
given instead, the first for the paper's incisor ("cutting"), the second for its molar.
"""

from __future__ import annotations

import argparse
import csv
import sys
from pathlib import Path
from typing import Any

import dental_shapes
import experiments
import numpy as np
import paper_charts
from experiments import TOLERANCE, Surface
from isolated import call
from numpy.typing import NDArray

Array = NDArray[Any]

HERE = Path(__file__).parent
PAPER = {"incisor": (3714, 0.7869, 0.3073), "molar": (6179, 0.8973, 0.4875)}
"""Table 1: points, seconds of the traditional method, seconds of the paper's method."""
TEETH = {"incisor": dental_shapes.incisor, "molar": dental_shapes.molar}
QUICK = {"incisor": 400, "molar": 600}
SIZES = (500, 1000, 2000, 4000, 8000, 16000)
QUICK_SIZES = (300, 600)
NOISE = 2e-4
"""Of the generated points, in parts of the diagonal: well below the tolerance."""
VOXELS = 100
QUICK_VOXELS = 40
"""Cubes along the diagonal, the same for both methods."""


def main() -> int:
    """Run the experiments; 0 when all succeeded, 1 when one failed, 130 after Ctrl-C."""
    args = _arguments()
    output = args.output.resolve()
    output.mkdir(parents=True, exist_ok=True)
    failures: list[str] = []
    try:
        files = dict(zip(PAPER, args.inputs or [None, None], strict=True))
        clouds = {name: _load(name, file, max(SIZES)) for name, file in files.items()}
        teeth = {name: TEETH[name]() for name, file in files.items() if file is None}
        _figure_2(clouds, QUICK_SIZES if args.quick else SIZES, output, args.timeout, failures)
        _table_1(clouds, teeth, args, output, failures)
    except KeyboardInterrupt:
        print(f"\ninterrupted; what was finished is in {output}", file=sys.stderr)
        return 130
    except (OSError, ValueError) as error:
        print(f"paper: {error}", file=sys.stderr)
        return 2
    for failure in failures:
        print(f"failed: {failure}")
    print(f"charts, pictures and tables are in {output}")
    return 1 if failures else 0


def _load(name: str, file: Path | None, count: int) -> Array:
    """Return up to ``count`` points in random order, so that the first n are a thinner cloud."""
    if file is None:
        tooth = TEETH[name]()
        diagonal = 2.0 * float(np.linalg.norm(tooth.half_size))
        return tooth.sample(count, noise=NOISE * diagonal)
    from o3d_sofnn import adapters, io

    points = adapters.read_cloud(io.read_point_cloud(file)).points
    points = points[np.isfinite(points).all(axis=1)]
    return np.random.default_rng(0).permutation(points)[:count]


def _figure_2(
    clouds: dict[str, Array],
    sizes: tuple[int, ...],
    output: Path,
    timeout: float,
    failures: list[str],
) -> None:
    """Count points with offset points over the size of the input."""
    rows: list[dict[str, Any]] = []
    for name, points in clouds.items():
        for n in sorted({min(n, len(points)) for n in sizes}):
            print(f"Figure 2: {name}, {n} points", flush=True)
            outcome = call(experiments.count_offsets, points[:n].copy(), timeout=timeout)
            if outcome.error:
                failures.append(f"Figure 2, {name}, {n} points: {outcome.error}")
                continue
            rows.append(
                {
                    "model": name,
                    "points": n,
                    "traditional": 3 * n,
                    "ours": n + outcome.value,
                    "offset_points": outcome.value,
                }
            )
            _write(output / "figure2.csv", rows)
    if rows:
        paper_charts.figure_2(output / "figure2.png", rows)
        for name in clouds:
            print(f"  {name}: {_growth([row for row in rows if row['model'] == name])}")


def _growth(rows: list[dict[str, Any]]) -> str:
    """Say how the number of offset points grows with the number of points."""
    counts = [(row["points"], row["offset_points"]) for row in rows if row["offset_points"] > 0]
    if not counts:
        return "no offset points"
    share = max(offsets / n for n, offsets in counts)
    text = f"offset points at most {100 * share:.1f} % of the points"
    if len(counts) > 1:
        slope = np.polyfit(*np.log(np.array(counts, float)).T, 1)[0]
        text += f", growing as n^{slope:.2f}"
    return text


def _table_1(
    clouds: dict[str, Array],
    teeth: dict[str, dental_shapes.Tooth],
    args: argparse.Namespace,
    output: Path,
    failures: list[str],
) -> None:
    """Time both methods at the paper's sizes, and draw their surfaces (Figure 3)."""
    rows: list[dict[str, Any]] = []
    quick, timeout = args.quick, args.timeout
    threads = _best_blas_threads(next(iter(clouds.values())), timeout)
    for name, points in clouds.items():
        n = min(QUICK[name] if quick else PAPER[name][0], len(points))
        points = points[:n].copy()
        size = float(np.linalg.norm(np.ptp(points, axis=0))) / (QUICK_VOXELS if quick else VOXELS)
        surfaces: dict[str, Surface] = {}
        for method in (experiments.variational, experiments.progressive):
            kind = method.__name__
            print(f"Table 1: {name}, {n} points, {kind}", flush=True)
            outcome = call(
                method,
                points,
                size,
                timeout=timeout,
                environment=threads if kind == "variational" else None,
            )
            if outcome.error:
                failures.append(f"Table 1, {name}, {kind}: {outcome.error}")
            else:
                surfaces[kind] = outcome.value
        if len(surfaces) == 2:
            rows.append(_row(name, points, teeth.get(name), surfaces))
            _write(output / "table1.csv", rows)
        if surfaces:
            drawn = call(
                paper_charts.figure_3,
                output / f"figure3_{name}.png",
                points,
                surfaces,
                timeout=timeout,
            )
            if drawn.error:
                failures.append(f"Figure 3, {name}: {drawn.error}")
    table = paper_charts.table(rows, PAPER)
    (output / "table1.md").write_text(table, encoding="utf-8")
    print(table)


def _best_blas_threads(points: Array, timeout: float) -> dict[str, str]:
    """Find out which number of BLAS threads serves the traditional method best here."""
    choices = ({}, {"OPENBLAS_NUM_THREADS": "1"})
    sample = points[:1000].copy()
    times = []
    for choice in choices:
        outcome = call(
            experiments.solution_seconds, sample, timeout=timeout, environment=dict(choice)
        )
        times.append(np.inf if outcome.error else outcome.value)
    return dict(choices[int(np.argmin(times))])


def _row(
    name: str, points: Array, tooth: dental_shapes.Tooth | None, surfaces: dict[str, Surface]
) -> dict[str, Any]:
    row: dict[str, Any] = {"model": name, "points": len(points)}
    diagonal = np.linalg.norm(np.ptp(points, axis=0))
    for kind, surface in zip(("traditional", "ours"), surfaces.values(), strict=True):
        for stage in ("normals", "fit", "surface", "total"):
            row[f"{kind}_{stage}_s"] = round(surface.seconds[stage], 4)
        row[f"{kind}_with_offsets"] = surface.n_points
        row[f"{kind}_rms_error"] = _rms(surface.errors)
        row[f"{kind}_max_error"] = float(f"{surface.errors.max():.3g}")
        row[f"{kind}_within_tolerance"] = round(float(np.mean(surface.errors <= TOLERANCE)), 4)
        row[f"{kind}_true_error"] = (
            None if tooth is None else _rms(tooth.distance(surface.vertices) / diagonal)
        )
    ours, theirs = surfaces["progressive"], surfaces["variational"]
    row["time_ratio"] = round(ours.seconds["total"] / theirs.seconds["total"], 4)
    return row


def _rms(errors: Array) -> float:
    return float(f"{np.sqrt(np.mean(errors**2)):.3g}")


def _write(path: Path, rows: list[dict[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("inputs", nargs="*", type=Path, help="two point clouds: incisor, molar")
    parser.add_argument(
        "--output",
        type=Path,
        default=HERE / "output" / "paper",
        help="folder for charts and tables (default: %(default)s)",
    )
    parser.add_argument("--quick", action="store_true", help="a tenth of the paper's sizes")
    parser.add_argument(
        "--timeout", type=float, default=600.0, help="seconds for one run (default: %(default)g)"
    )
    args = parser.parse_args()
    if len(args.inputs) not in (0, 2):
        parser.error(f"inputs: expected none or two files, got {len(args.inputs)}")
    return args


if __name__ == "__main__":
    sys.exit(main())
