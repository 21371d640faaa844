"""Section 5 of the paper, repeated: Figure 2, Figure 3 and Table 1, with tables "paper / here".

Without arguments the inputs are two crowns from ``dental_shapes``; any two files can be given
instead, the first for the paper's incisor ("cutting"), the second for its molar. From a file with
more points than in the paper, as many as in the paper are drawn at random; a mesh with fewer
vertices is sampled.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import demo
import numpy as np
from numpy.typing import NDArray
from paper_parts import charts as paper_charts
from paper_parts import dental_shapes, experiments
from paper_parts.experiments import Surface

from o3d_sofnn.compare import cases
from o3d_sofnn.compare.isolated import call

Array = NDArray[Any]

PAPER = {"incisor": (3714, 0.7869, 0.3073), "molar": (6179, 0.8973, 0.4875)}
"""Table 1: points, seconds of the traditional method, seconds of the paper's method."""
TEETH = {"incisor": dental_shapes.incisor, "molar": dental_shapes.molar}
QUICK = {"incisor": 400, "molar": 600}
SIZES = (500, 1000, 2000, 4000, 8000, 16000)
QUICK_SIZES = (300, 600)
NOISE = 2e-4
"""Noise of the generated points, as a fraction of the diagonal: well below the tolerance."""
VOXELS = 100
QUICK_VOXELS = 40
"""Cubes along the diagonal, the same for both methods."""


@dataclass
class Input:
    """A tooth of the paper, and the points that represent it here.

    Attributes
    ----------
    name : str
        incisor or molar.
    file : Path or None
        File with the points; None generates them.
    """

    name: str
    file: Path | None

    @cached_property
    def points(self) -> Array:
        """Return points in random order, so that the first n are a thinner cloud."""
        if self.file is None:
            tooth = TEETH[self.name]()
            diagonal = 2.0 * float(np.linalg.norm(tooth.half_size))
            return tooth.sample(max(SIZES), noise=NOISE * diagonal)
        found = cases.read_points(self.file)
        if len(found) < PAPER[self.name][0]:
            found = experiments.sample(self.file, max(SIZES))
        return np.random.default_rng(0).permutation(found)[: max(SIZES)]

    @property
    def tooth(self) -> dental_shapes.Tooth | None:
        """Return the true surface, if it is known."""
        return TEETH[self.name]() if self.file is None else None


@dataclass
class Paper:
    """The experiments, and their results so far."""

    output: Path
    quick: bool
    timeout: float
    figure_2: list[dict[str, Any]] = field(default_factory=list)
    table_1: list[dict[str, Any]] = field(default_factory=list)

    def count(self, source: Input, size: int) -> None:
        """Figure 2: count points with offset points."""
        n = min(size, len(source.points))
        if any(row["model"] == source.name and row["points"] == n for row in self.figure_2):
            print(f"  there are only {n} points")
            return
        with demo.step(f"{n} points"):
            offsets = call(
                experiments.count_offsets, source.points[:n].copy(), timeout=self.timeout
            ).get()
        self.figure_2.append(
            {
                "model": source.name,
                "points": n,
                "traditional": 3 * n,
                "ours": n + offsets,
                "offset_points": offsets,
            }
        )
        demo.write_csv(self.output / "figure2.csv", self.figure_2)
        print(f"  {offsets} offset points, {100 * offsets / n:.1f} % of the points")

    def compare(self, source: Input) -> None:
        """Table 1 and Figure 3: time both methods at the paper's size and draw their surfaces."""
        n = QUICK[source.name] if self.quick else PAPER[source.name][0]
        points = source.points[:n].copy()
        voxels = QUICK_VOXELS if self.quick else VOXELS
        size = float(np.linalg.norm(np.ptp(points, axis=0))) / voxels
        surfaces: dict[str, Surface] = {}
        with demo.step(f"ours, {n} points"):
            surfaces["progressive"] = call(
                experiments.progressive, points, size, timeout=self.timeout
            ).get()
        surfaces["variational"] = self._variational(points, size)
        self.table_1.append(_row(source, points, surfaces))
        demo.write_csv(self.output / "table1.csv", self.table_1)
        paper_charts.figure_3(self.output / f"figure3_{source.name}.png", points, surfaces)

    def _variational(self, points: Array, size: float) -> Surface:
        """Run the traditional method with the number of BLAS threads that serves it best."""
        sample = points[:1000].copy()
        choices: list[tuple[float, dict[str, str]]] = []
        for choice in ({}, {"OPENBLAS_NUM_THREADS": "1"}):
            with demo.step(f"traditional method, {len(sample)} points, {_threads(choice)}"):
                outcome = call(
                    experiments.solution_seconds, sample, timeout=self.timeout, environment=choice
                )
            choices.append((np.inf if outcome.error else outcome.value, choice))
        choices.sort(key=lambda pair: pair[0])
        for _, choice in choices:
            with demo.step(f"traditional method, {len(points)} points, {_threads(choice)}"):
                outcome = call(
                    experiments.variational, points, size, timeout=self.timeout, environment=choice
                )
            # Some builds of OpenBLAS crash on a matrix of this size with several threads.
            if outcome.error is None:
                break
            print(f"  the traditional method failed with {_threads(choice)}: {outcome.error}")
        return outcome.get()

    def finish(self) -> None:
        """Draw Figure 2 and print the tables."""
        if self.figure_2:
            paper_charts.figure_2(self.output / "figure2.png", self.figure_2)
            for name in dict.fromkeys(row["model"] for row in self.figure_2):
                own = [row for row in self.figure_2 if row["model"] == name]
                print(f"Figure 2, {name}: {growth(own)}")
        if self.table_1:
            table = paper_charts.table(self.table_1, PAPER)
            (self.output / "table1.md").write_text(table, encoding="utf-8")
            print(table)


def main() -> int:
    """Run the experiments and return the exit code, see :func:`demo.work`."""
    args = _arguments()
    paper = Paper(args.out.resolve(), args.quick, args.timeout)
    sources = [Input(*pair) for pair in zip(PAPER, args.inputs or [None, None], strict=True)]
    jobs: dict[str, Callable[[], None]] = {}
    for source in sources:
        for size in QUICK_SIZES if args.quick else SIZES:
            jobs[f"Figure 2: {source.name}, {size} points"] = lambda source=source, size=size: (
                paper.count(source, size)
            )
    for source in sources:
        jobs[f"Table 1, Figure 3: {source.name}"] = lambda source=source: paper.compare(source)
    return demo.work(jobs, paper.output, paper.finish)


def growth(rows: list[dict[str, Any]]) -> str:
    """Describe how the number of offset points grows with the number of points."""
    counts = [(row["points"], row["offset_points"]) for row in rows if row["offset_points"] > 0]
    if not counts:
        return "no offset points"
    shares = ", ".join(f"{100 * offsets / n:.1f} % of {n}" for n, offsets in counts)
    text = f"offset points {shares} points"
    if len(counts) > 1:
        slope = np.polyfit(*np.log(np.array(counts, float)).T, 1)[0]
        text += f", growing as n^{slope:.2f}"
    return text


def _row(source: Input, points: Array, surfaces: dict[str, Surface]) -> dict[str, Any]:
    row: dict[str, Any] = {"model": source.name, "points": len(points)}
    diagonal = np.linalg.norm(np.ptp(points, axis=0))
    for kind, surface in (
        ("traditional", surfaces["variational"]),
        ("ours", surfaces["progressive"]),
    ):
        for stage in ("normals", "fit", "surface", "total"):
            row[f"{kind}_{stage}_s"] = round(surface.seconds[stage], 4)
        row[f"{kind}_with_offsets"] = surface.n_points
        row[f"{kind}_rms_error"] = _rms(surface.errors)
        row[f"{kind}_median_error"] = float(f"{np.median(surface.errors):.3g}")
        row[f"{kind}_max_error"] = float(f"{surface.errors.max():.3g}")
        row[f"{kind}_within_tolerance"] = round(
            float(np.mean(surface.errors <= experiments.TOLERANCE)), 4
        )
        row[f"{kind}_true_error"] = (
            None
            if source.tooth is None
            else _rms(source.tooth.distance(surface.vertices) / diagonal)
        )
    row["time_ratio"] = round(row["ours_total_s"] / row["traditional_total_s"], 4)
    return row


def _threads(environment: dict[str, str]) -> str:
    return "one thread" if environment else "all threads of BLAS"


def _rms(errors: Array) -> float:
    return float(f"{np.sqrt(np.mean(errors**2)):.3g}")


def _arguments() -> argparse.Namespace:
    parser = demo.parser(__doc__, "paper", timeout=600.0)
    parser.add_argument("inputs", nargs="*", type=Path, help="two files: incisor, molar")
    args = parser.parse_args()
    if len(args.inputs) not in (0, 2):
        parser.error(f"inputs: expected none or two files, got {len(args.inputs)}")
    return args


if __name__ == "__main__":
    sys.exit(main())
