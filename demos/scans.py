"""What becomes of scans with automatic settings: ``python scans.py FILE ...``.

Draws a sheet to look at (points, our mesh, Open3D's chain of normals, tangent planes and Poisson;
backs of triangles red, what is far from all points yellow) and prints a table: time, memory, the
mesh, how far the inliers are from it, and our own check of it. Times are those of the processor,
all cores together, reading apart; memory is that of the process, ours alone.
"""

from __future__ import annotations

import sys
import time
from functools import partial
from pathlib import Path
from typing import Any

import contact_sheet
import demo
import numpy as np
from contact_sheet import Part
from PIL import Image

from o3d_sofnn.compare import cases
from o3d_sofnn.compare.isolated import call, peak_mb
from o3d_sofnn.compare.measure import distances
from o3d_sofnn.compare.peers import open3d_poisson
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
    "near": "within a spacing, %",
    "invented": "invented area, %",
    "crumbs": "crumbs",
    "closed": "closed",
    "evidence": "sides by",
}
"""Of the table; noise and distance are in percent of the diagonal."""
BYTES = 3_000_000
"""Of the sheet, at most."""


def main() -> int:
    """Reconstruct all files and return the exit code, see :func:`demo.work`."""
    parser = demo.parser(__doc__, "scans", timeout=600.0)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="points, or meshes")
    args = parser.parse_args()
    output = args.out.resolve()
    rows: list[dict[str, Any]] = []
    count = QUICK if args.quick else None
    drawn: list[Image.Image] = []
    jobs = {
        str(file): partial(_run, file, count, output, args.timeout, rows, drawn)
        for file in args.files
    }

    def finish() -> None:
        print("\n".join(table(rows)))
        if drawn:
            contact_sheet.save(output / "sheet.png", drawn, BYTES)

    return demo.work(jobs, output, finish)


def measure(file: Path, count: int | None) -> tuple[dict[str, Any], Image.Image]:
    """Reconstruct the points of a file, and draw what came out.

    Parameters
    ----------
    file : Path
        A cloud, or a mesh whose vertices are taken.
    count : int or None
        Points to keep, drawn at random; None keeps all.

    Returns
    -------
    row : dict
        Keys ``COLUMNS``.
    picture : PIL.Image.Image
        Of the sheet.
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
    quality = found.quality
    row = {
        "file": file.name,
        "points": len(points),
        "seconds": seconds,
        "peak_mb": memory,
        "triangles": len(found.triangles),
        "pieces": mesh_properties.component_labels(found.triangles)[0],
        "noise": percent * found.normals.noise_level,
        "distance": percent * float(distance),
        "outliers": 100.0 * float(found.normals.outliers.mean()),
        "near": 100.0 * quality.near,
        "invented": 100.0 * quality.invented,
        "crumbs": quality.crumbs,
        "closed": "yes" if found.watertight else "no",
        "evidence": found.normals.evidence.kind,
    }
    parts = [
        Part(f"{len(points)} points, noise {row['noise']:.3f} % of the diagonal", points),
        Part(
            f"ours, {seconds:.1f} CPU s, {row['triangles']} triangles, "
            f"{row['near']:.0f} % within a spacing, {row['invented']:.1f} % invented, "
            f"{row['crumbs']} crumbs",
            found.vertices,
            found.triangles,
        ),
        _chain(points),
    ]
    views = contact_sheet.views_of(found.normals.normals)
    return row, contact_sheet.draw_row(file.stem, inliers, views, parts)


def _chain(points: Any) -> Part:
    """Open3D's chain on the same points, or what it says instead of a mesh."""
    started = time.process_time()
    try:
        peer = open3d_poisson(points)
    except RuntimeError as error:
        return Part(f"Open3D's chain failed: {str(error)[:60]}", points[:0])
    seconds = time.process_time() - started
    caption = f"Open3D's chain, {seconds:.1f} CPU s, {len(peer.triangles)} triangles"
    return Part(caption, peer.vertices, peer.triangles)


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Return the lines of the table, in Markdown."""
    lines = [f"| {' | '.join(COLUMNS.values())} |", "|---" * len(COLUMNS) + "|"]
    for row in rows:
        memory = "" if row["peak_mb"] is None else f"{row['peak_mb']:.0f}"
        lines.append(
            f"| {row['file']} | {row['points']} | {row['seconds']:.1f} | {memory} "
            f"| {row['triangles']} | {row['pieces']} | {row['noise']:.4f} | {row['distance']:.4f} "
            f"| {row['outliers']:.2f} | {row['near']:.1f} | {row['invented']:.1f} "
            f"| {row['crumbs']} | {row['closed']} | {row['evidence']} |"
        )
    return lines


def _run(
    file: Path,
    count: int | None,
    output: Path,
    timeout: float,
    rows: list[dict[str, Any]],
    drawn: list[Image.Image],
) -> None:
    row, picture = call(measure, file, count, timeout=timeout).get()
    rows.append(row)
    drawn.append(picture)
    print(f"  {row['triangles']} triangles, {row['seconds']:.1f} CPU seconds", flush=True)
    demo.write_csv(output / "scans.csv", rows)
    contact_sheet.save(output / f"{file.stem}.png", [picture])


if __name__ == "__main__":
    sys.exit(main())
