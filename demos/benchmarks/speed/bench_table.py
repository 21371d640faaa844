"""The table of the benchmark: medians, ratios to the peers, growth, threads, as Markdown."""

from __future__ import annotations

import math
from statistics import median
from typing import Any

Record = dict[str, Any]
Found = dict[str, dict[str, list[Record]]]

LINES = {
    "ours_normals": "normals, oriented",
    "open3d_normals": "Open3D normals, not oriented",
    "ours_mesh": "mesh from points",
    "open3d_poisson": "Open3D Poisson, given true normals",
    "open3d_chain": "Open3D normals, orientation, Poisson",
    "meshlab_chain": "MeshLab normals, screened Poisson",
}
BARS = (
    ("normals / Open3D normals not oriented", "ours_normals", "open3d_normals", "seconds", 1.0),
    ("normals / Open3D normals and orientation", "ours_normals", "open3d_chain", "oriented", 0.05),
    ("mesh / Open3D chain", "ours_mesh", "open3d_chain", "seconds", 0.2),
    ("mesh / Open3D Poisson given normals", "ours_mesh", "open3d_poisson", "seconds", 0.5),
    ("mesh / MeshLab chain", "ours_mesh", "meshlab_chain", "seconds", 0.1),
    ("normals / Open3D normals, CPU time", "ours_normals", "open3d_normals", "cpu", 1.0),
    ("mesh / Open3D chain, CPU time", "ours_mesh", "open3d_chain", "cpu", 0.2),
    ("memory, mesh / Open3D Poisson", "ours_mesh", "open3d_poisson", "peak_mb", 1.0),
)
"""Ratio, what is divided, by what, which figure, and the ratio that is wanted at most."""


def table(records: list[Record]) -> str:
    """Summarise measurements.

    Parameters
    ----------
    records : list of dict
        As ``bench.py`` writes them.

    Returns
    -------
    str
        Markdown.
    """
    found: Found = {}
    for record in records:
        if not record.get("error"):
            found.setdefault(record["cloud"], {}).setdefault(record["task"], []).append(record)
    parts = [_times(found), _ratios(found), _threads(found), _stages(found), _other(found)]
    return "\n\n".join(part for part in parts if part) + "\n"


def _times(found: Found) -> str:
    rows = []
    for cloud, tasks in found.items():
        for task, title in LINES.items():
            if task in tasks:
                runs = tasks[task]
                rows.append(
                    [
                        cloud,
                        title,
                        f"{_median(runs, 'seconds'):.2f}",
                        f"{_median(runs, 'cpu'):.2f}",
                        f"{_median(runs, 'peak_mb'):.0f}",
                        f"{_median(runs, 'triangles'):.0f}" if "triangles" in runs[0] else "",
                        str(len(runs)),
                    ]
                )
    return _markdown(["cloud", "what", "s", "CPU s", "peak MB", "triangles", "runs"], rows)


def _ratios(found: Found) -> str:
    rows = []
    for title, ours, peer, figure, bar in BARS:
        row = [title, f"{bar:g}"]
        for tasks in found.values():
            both = ours in tasks and peer in tasks
            key = "seconds" if figure == "oriented" else figure
            ratio = _median(tasks[ours], key) / _median(tasks[peer], figure) if both else None
            row.append("" if ratio is None else f"{ratio:.3f}" if bar < 0.1 else f"{ratio:.2f}")
        rows.append(row)
    return _markdown(["ratio", "wanted", *found], [row for row in rows if any(row[2:])])


def _threads(found: Found) -> str:
    rows = []
    for cloud, tasks in found.items():
        for task in ("ours_normals", "ours_mesh"):
            if task in tasks and f"{task}_1" in tasks:
                all_of_them = [task, f"{task}_1", f"{task}_4"]
                digests = {r["digest"] for name in all_of_them for r in tasks.get(name, [])}
                gain = _median(tasks[f"{task}_1"], "seconds") / _median(tasks[task], "seconds")
                equal = "yes" if len(digests) == 1 else "NO"
                rows.append([cloud, LINES[task], f"{gain:.2f}", equal])
    return _markdown(["cloud", "what", "one thread / all", "same bits with 1, all, 4"], rows)


def _stages(found: Found) -> str:
    rows, names = [], []
    for cloud, tasks in found.items():
        runs = tasks.get("ours_mesh", [])
        if runs:
            keys = [key for key in runs[0] if key.startswith("stage ")]
            names = [key.removeprefix("stage ") for key in keys]
            rows.append([cloud, *(f"{_median(runs, key):.2f}" for key in keys)])
    return _markdown(["seconds a stage, mesh", *names], rows)


def _other(found: Found) -> str:
    lines = []
    for task in ("ours_normals", "ours_mesh"):
        sizes = sorted(
            (tasks[task][0]["points"], tasks[task])
            for cloud, tasks in found.items()
            if task in tasks and tasks[task][0]["points"] >= 100_000 and cloud.startswith("crown")
        )
        if len(sizes) > 1:
            (small, first), *_, (large, last) = sizes
            for figure, title in (("seconds", "time"), ("peak_mb", "memory")):
                growth = math.log(_median(last, figure) / _median(first, figure))
                power = growth / math.log(large / small)
                lines.append(f"* {LINES[task]}: {title} grows as n^{power:.2f}, {small} to {large}")
    calls = [r for tasks in found.values() for r in tasks.get("ours_normals", [])]
    if calls:
        worst = median(r["cpu"] / r["second"] for r in calls)
        lines.append(f"* first call / second call, normals, processor time: {worst:.2f}")
    imports = [r for tasks in found.values() for r in tasks.get("import_time", [])]
    if imports:
        added = _median(imports, "seconds")
        lines.append(f"* import o3d_sofnn after open3d: {added:.2f} s")
    return "\n".join(lines)


def _median(runs: list[Record], figure: str) -> float:
    return float(median(r.get(figure) or math.nan for r in runs))


def _markdown(head: list[str], rows: list[list[str]]) -> str:
    if not rows:
        return ""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
