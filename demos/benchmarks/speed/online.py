"""A scan that grows: ``python online.py [SWEEP ...] [--out FOLDER]``.

Sweeps of one object are added one after the other, and the mesh so far is drawn after each: files
in the order given, or, without files, a scanner that flies around a generated tooth. Prints a table
of cells, time and triangles after each sweep; the last lines compare with all points at once and
say what adding every sweep again changes.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import demos_path
import numpy as np
from numpy.typing import NDArray
from paper_parts.dental_shapes import molar
from pictures import Panel, draw
from scipy.spatial import cKDTree

from o3d_sofnn import OnlineReconstruction, reconstruct_surface
from o3d_sofnn.compare.raster import View
from o3d_sofnn.files.point_files import read_points

Array = NDArray[Any]

SEEN = 0.2
"""Smallest cosine between a surface and the ray of the scanner."""


def main() -> int:
    """Add the sweeps, and draw the strip."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sweeps", type=Path, nargs="*", metavar="SWEEP", help="point files")
    parser.add_argument("--out", type=Path, default=demos_path.DEMOS / "output" / "online")
    parser.add_argument("--points", type=int, default=20_000, help="points of the generated tooth")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    sweeps = [read(file) for file in options.sweeps] or list(flight(options.points))
    warnings.simplefilter("ignore")  # of components that turn: each line says how many
    model = OnlineReconstruction()
    panels = [Panel("all points", np.concatenate([points for points, _ in sweeps]))]
    print("| sweep | its points | cells | add, s | mesh, s | triangles | turned |")
    print("|---:|---:|---:|---:|---:|---:|---:|")
    for number, (points, place) in enumerate(sweeps, 1):
        added, meshed, mesh = step(model, points, place)
        print(
            f"| {number} | {len(points)} | {len(model)} | {added:.2f} | {meshed:.2f} "
            f"| {len(mesh[1])} | {len(model.turned)} |",
            flush=True,
        )
        panels.append(Panel(f"after sweep {number}", *mesh))
    compare(model, mesh, sweeps)
    view = View((0.5, -0.7, 0.5), (0.0, 0.0, 1.0))
    draw(options.out / "online.png", panels, view, height=320, columns=4)
    print(f"\npicture {options.out / 'online.png'}")
    return 0


def step(
    model: OnlineReconstruction, points: Array, place: Array | None
) -> tuple[float, float, Any]:
    """Add a sweep; return the seconds of that and of the mesh, and the mesh."""
    begin = time.perf_counter()
    model.add(points, viewpoint=place)
    middle = time.perf_counter()
    mesh = model.mesh()
    return middle - begin, time.perf_counter() - middle, mesh


def compare(
    model: OnlineReconstruction, mesh: Any, sweeps: list[tuple[Array, Array | None]]
) -> None:
    """Print what all points at once give, and what every sweep once more changes."""
    points = np.concatenate([sweep for sweep, _ in sweeps])
    place = None
    if all(each is not None for _, each in sweeps):
        place = np.concatenate([np.broadcast_to(where, x.shape) for x, where in sweeps])
    distinct = np.unique(points, axis=0)  # sweeps may have seen the same points
    spacing = float(np.median(cKDTree(distinct).query(distinct, 2)[0][:, 1]))
    begin = time.perf_counter()
    whole = reconstruct_surface(points, viewpoint=place)
    print(
        f"\nall points at once: {time.perf_counter() - begin:.2f} s, "
        f"{distance(mesh, whole) / spacing:.2f} spacings between the vertices of both"
    )
    cells = len(model)
    for again, where in sweeps:
        model.add(again, viewpoint=where)
    twice = model.mesh()
    print(
        f"every sweep once more: {len(model)} cells ({len(model) / cells - 1.0:+.1%}), "
        f"{distance(mesh, twice) / spacing:.3f} spacings"
    )


def distance(one: Any, other: Any) -> float:
    """Mean distance between the vertices of two meshes, both ways."""
    there, back = cKDTree(one[0]).query(other[0])[0], cKDTree(other[0]).query(one[0])[0]
    return float(0.5 * (there.mean() + back.mean()))


def read(file: Path) -> tuple[Array, Array | None]:
    """Read a sweep, and where it was seen from, if the file says so."""
    source = read_points(file)
    return source.points, source.viewpoint


def flight(n: int, stations: int = 7) -> Any:
    """Yield what a scanner sees of a tooth from places around and above it."""
    tooth = molar()
    points = tooth.sample(n, noise=0.0005)
    normals = tooth.normals(points)
    middle = points.mean(axis=0)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    for i in range(stations):
        angle = 2.0 * np.pi * i / (stations - 1)
        way = [np.cos(angle), np.sin(angle), 0.5] if i < stations - 1 else [0.0, 0.0, 1.0]
        place = middle + 2.0 * size * np.array(way) / np.linalg.norm(way)
        ray = place - points
        cosine = (normals * ray).sum(axis=1) / np.linalg.norm(ray, axis=1)
        yield points[cosine > SEEN], place


if __name__ == "__main__":
    sys.exit(main())
