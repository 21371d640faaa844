"""What becomes of real scans with automatic settings: ``python scans.py FILE ...``.

Prints a table of time, memory, the mesh, and how far the points that count are from it. Times are
those of the processor, all cores together, reading apart; memory is that of the process. Open3D's
and MeshLab's reconstructions of the same files: ``o3d-sofnn compare --clouds``.
"""

from __future__ import annotations

import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import demo
import numpy as np

from o3d_sofnn.compare import cases
from o3d_sofnn.compare.isolated import call, peak_mb
from o3d_sofnn.compare.measure import distances
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.pipeline import reconstruct_surface

ASKED = 50_000
"""Points whose distance from the surface is looked at."""
QUICK = 5_000
"""Points of a file that are taken with ``--quick``."""
COLUMNS = {
    "file": "file",
    "points": "points",
    "seconds": "CPU seconds",
    "peak_mb": "peak MB",
    "triangles": "triangles",
    "pieces": "pieces",
    "noise": "noise found",
    "distance": "median distance of the inliers",
    "outliers": "outliers, %",
    "closed": "closed",
}
"""Of the table; noise and distance are in percent of the diagonal."""


def main() -> int:
    """Reconstruct all files and return the exit code, see :func:`demo.work`."""
    parser = demo.parser(__doc__, "scans", timeout=600.0)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="points, or meshes")
    args = parser.parse_args()
    output = args.out.resolve()
    rows: list[dict[str, Any]] = []
    count = QUICK if args.quick else None
    jobs = {
        str(file): partial(_run, file, count, output / "scans.csv", args.timeout, rows)
        for file in args.files
    }
    return demo.work(jobs, output, lambda: print("\n".join(table(rows))))


def measure(file: Path, count: int | None) -> dict[str, Any]:
    """Reconstruct the points of a file.

    Parameters
    ----------
    file : Path
        A cloud, or a mesh whose vertices are taken.
    count : int or None
        Points to keep, drawn at random; None keeps all.

    Returns
    -------
    dict
        Keys ``COLUMNS``.
    """
    rng = np.random.default_rng(0)
    points = cases.read_points(file)
    if count is not None and count < len(points):
        points = points[np.sort(rng.choice(len(points), count, replace=False))]
    started = time.process_time()
    found = reconstruct_surface(points)
    seconds, memory = time.process_time() - started, peak_mb()
    inliers = points[~found.normals.outliers]
    asked = rng.choice(len(inliers), min(ASKED, len(inliers)), replace=False)
    distance = np.median(distances(inliers[asked], found.vertices, found.triangles)[0])
    percent = 100.0 / float(np.linalg.norm(np.ptp(points, axis=0)))
    return {
        "file": file.name,
        "points": len(points),
        "seconds": seconds,
        "peak_mb": memory,
        "triangles": len(found.triangles),
        "pieces": mesh_properties.component_labels(found.triangles)[0],
        "noise": percent * found.normals.noise_level,
        "distance": percent * float(distance),
        "outliers": 100.0 * float(found.normals.outliers.mean()),
        "closed": "yes" if found.watertight else "no",
    }


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Return the lines of the table, in Markdown."""
    lines = [f"| {' | '.join(COLUMNS.values())} |", "|---" * len(COLUMNS) + "|"]
    for row in rows:
        memory = "" if row["peak_mb"] is None else f"{row['peak_mb']:.0f}"
        lines.append(
            f"| {row['file']} | {row['points']} | {row['seconds']:.1f} | {memory} "
            f"| {row['triangles']} | {row['pieces']} | {row['noise']:.4f} | {row['distance']:.4f} "
            f"| {row['outliers']:.2f} | {row['closed']} |"
        )
    return lines


def _run(
    file: Path, count: int | None, log: Path, timeout: float, rows: list[dict[str, Any]]
) -> None:
    rows.append(call(measure, file, count, timeout=timeout).get())
    print(f"  {rows[-1]['triangles']} triangles, {rows[-1]['seconds']:.1f} CPU seconds", flush=True)
    demo.write_csv(log, rows)


if __name__ == "__main__":
    sys.exit(main())
