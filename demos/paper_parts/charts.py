"""Charts, pictures and the table of ``paper.py``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pictures
from numpy.typing import NDArray
from paper_parts.experiments import TOLERANCE, Surface

from o3d_sofnn.compare.colors import heat_colors
from o3d_sofnn.compare.raster import View

Array = NDArray[Any]

COLORS = {"incisor": "#1f6fb2", "molar": "#c2571a"}
TITLES = {"variational": "variational", "progressive": "progressive (ours)"}
VIEW = View((0.5, -1.0, 0.9))


def figure_2(path: Path, rows: list[dict[str, Any]]) -> None:
    """Draw the number of points including offset points against the number of points."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (axes, growth) = pyplot.subplots(1, 2, figsize=(11.0, 4.4), layout="constrained")
    for model, color in COLORS.items():
        own = [row for row in rows if row["model"] == model]
        n = [row["points"] for row in own]
        axes.plot(n, [row["ours"] for row in own], "o-", color=color, label=f"ours, {model}")
        growth.loglog(n, [row["offset_points"] for row in own], "o-", color=color)
    n = sorted({row["points"] for row in rows})
    axes.plot(n, [3 * k for k in n], "s--", color="0.35", label="traditional, any model")
    axes.plot(n, n, ":", color="0.6", label="points alone")
    axes.set(ylabel="points with offset points", title="Figure 2: points with offset points")
    growth.loglog(n, [2 * k for k in n], "s--", color="0.35")
    growth.set(ylabel="offset points", title="offset points alone, both axes logarithmic")
    for each in (axes, growth):
        each.set_xlabel("points")
        each.grid(alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=130)
    pyplot.close(figure)


def figure_3(path: Path, points: Array, surfaces: dict[str, Surface]) -> None:
    """Draw the surfaces of both methods, and the points coloured by their distance from them."""
    panels = [pictures.Panel(f"{len(points):,} points", points)]
    for kind in TITLES:
        surface = surfaces[kind]
        panels.append(pictures.Panel(TITLES[kind], surface.vertices, surface.triangles))
    for kind in TITLES:
        surface = surfaces[kind]
        share = 100.0 * np.mean(surface.errors <= TOLERANCE)
        colors = heat_colors(surface.errors, 2.0 * TOLERANCE)
        caption = f"{TITLES[kind]}: {share:.1f} % within {TOLERANCE:g}"
        panels.append(pictures.Panel(caption, points, colors=colors))
    pictures.draw(path, panels, VIEW, height=420)


def table(rows: list[dict[str, Any]], paper: dict[str, tuple[int, float, float]]) -> str:
    """Return the table "paper / here" in Markdown."""
    lines = [
        "Table 1, paper / here. Errors: distance of the input points from the surface, in parts of",
        f"the diagonal; tolerance {TOLERANCE:g}.",
        "",
        "| | points | traditional, s | ours, s | time ratio | with offsets: traditional, ours "
        "| median error: traditional, ours | rms error: traditional, ours "
        "| within tolerance: traditional, ours "
        "| rms distance from the truth: traditional, ours |",
        "| --- " * 10 + "|",
    ]
    for row in rows:
        name = row["model"]
        n, theirs, ours = paper[name]
        lines.append(
            f"| {name}, paper | {n} | {theirs:g} | {ours:g} | {ours / theirs:.2f} "
            f"| {3 * n}, not given | not given | not given | not given | not given |"
        )
        lines.append(
            f"| {name}, here | {row['points']} | {row['traditional_total_s']:.2f} "
            f"| {row['ours_total_s']:.2f} | {row['time_ratio']:.3f} "
            f"| {row['traditional_with_offsets']}, {row['ours_with_offsets']} "
            f"| {row['traditional_median_error']:.1e}, {row['ours_median_error']:.1e} "
            f"| {row['traditional_rms_error']:.1e}, {row['ours_rms_error']:.1e} "
            f"| {100 * row['traditional_within_tolerance']:.1f} %, "
            f"{100 * row['ours_within_tolerance']:.1f} % "
            f"| {_number(row['traditional_true_error'])}, {_number(row['ours_true_error'])} |"
        )
    return "\n".join(lines) + "\n"


def _number(value: float | None) -> str:
    return "not known" if value is None else f"{value:.1e}"
