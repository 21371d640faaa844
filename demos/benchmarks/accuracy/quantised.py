"""Coordinates on a grid: what rounding them costs the mesh, shape by shape and step by step.

Lengths are in spacings: the edge of the square of surface that a point has.

Every cloud is drawn once and rounded to steps of so many spacings, along all axes, as files with
few digits are, and along the last one, as depth is. A mesh of the rounded cloud shall have a
Chamfer distance of at most 1.3 x that of the cloud as drawn plus a third of the step, and as many
connected components. Usage: ``python demos/benchmarks/accuracy/quantised.py [FOLDER OF SCANS]``.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from o3d_sofnn import pipeline
from o3d_sofnn.compare.measure import distances
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.training import shapes
from o3d_sofnn.training.shapes import Mesh

Array = NDArray[Any]

STEPS, DEEP = (0.25, 0.5, 1.0, 2.0), (1.0, 2.0, 4.0)
"""Rounded to along all axes, and along the last one."""
ALLOWED = (1.3, 1.0 / 3.0)
"""Factor of the Chamfer distance without rounding, and the share of the step, that are allowed."""
TURN = Rotation.from_euler("xyz", (0.3, 0.5, 0.7)).as_matrix()
"""Turns the shapes out of the axes of the grid."""


def rounded(points: Array, step: Array) -> Array:
    """Round coordinates to multiples of the steps of their axes; 0 leaves them."""
    safe = np.where(step > 0.0, step, 1.0)
    return np.where(step > 0.0, np.round(points / safe) * safe, points)


def generated(count: int) -> Iterator[tuple[str, Array, Mesh | None]]:
    """Yield names, points and true surfaces of ten closed shapes."""
    for seed, shape in enumerate((*shapes.SHAPES, shapes.superquadric, shapes.bumpy_ball)):
        mesh = shape(np.random.default_rng(seed))
        mesh = mesh._replace(vertices=mesh.vertices @ TURN.T)
        points, _ = shapes.draw(mesh, count, 0.0, 0.0, np.random.default_rng(seed))
        yield f"{shape.__name__}-{seed}", points, mesh


def scans(folder: Path, count: int) -> Iterator[tuple[str, Array, Mesh | None]]:
    """Yield names and points (so many) of the closed meshes, with them, and scans in a folder."""
    import open3d as o3d

    for file in sorted(folder.iterdir()):
        if file.suffix in (".ply", ".obj", ".off", ".stl"):
            mesh = o3d.io.read_triangle_mesh(str(file)).remove_duplicated_vertices()
            found = Mesh(np.asarray(mesh.vertices), np.asarray(mesh.triangles).astype(np.int64))
            if len(found.triangles) and mesh_properties.is_closed(found.triangles):
                yield file.stem, mesh_properties.sample_surface(*found, count)[0], found
                continue
        points = np.asarray(o3d.io.read_point_cloud(str(file)).points)
        points = points[np.isfinite(points).all(axis=1)]
        if len(points) >= 1000:
            yield file.stem, np.random.default_rng(0).permutation(points)[:count], None


def chamfer(vertices: Array, triangles: Array, points: Array, truth: Mesh | None) -> float:
    """Mean distance from the true surface, both ways; of a scan, from its points to the mesh."""
    if truth is None:
        return float(distances(points, vertices, triangles)[0].mean())
    here = mesh_properties.sample_surface(vertices, triangles, len(points))[0]
    there = mesh_properties.sample_surface(*truth, len(points))[0]
    out, back = distances(here, *truth)[0], distances(there, vertices, triangles)[0]
    return float(0.5 * (out.mean() + back.mean()))


def measure(name: str, points: Array, truth: Mesh | None, steps: list[Array]) -> Iterator[str]:
    """Yield the rows of the table for one cloud; the first steps are none."""
    spacing = pipeline.estimate_normals(points).spacing
    limits = []
    for step in steps:
        started = time.perf_counter()
        found = pipeline.reconstruct_surface(rounded(points, step * spacing))
        seconds = time.perf_counter() - started
        error = chamfer(found.vertices, found.triangles, points, truth) / spacing
        parts = mesh_properties.component_labels(found.triangles)[0]
        limits = limits or [error, parts]
        limit = ALLOWED[0] * limits[0] + ALLOWED[1] * step.max()
        met = bool(error <= limit and parts == limits[1])
        yield (
            f"| {name} | {step[0]:g} | {step[2]:g} | {error:.3f} | {limit:.3f} | {parts} | "
            f"{found.normals.noise_level / spacing:.3f} | {seconds:.1f} | {('NO', 'yes')[met]} |"
        )


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, help="folder of scans and meshes")
    parser.add_argument("-n", type=int, default=10_000, help="points (default: %(default)s)")
    parser.add_argument("--only", default="", help="part of the names to measure")
    options = parser.parse_args(arguments)
    steps = [np.zeros(3)] + [np.full(3, step) for step in STEPS]
    steps += [np.array([0.0, 0.0, step]) for step in DEEP]
    print("| cloud | x and y | z | Chamfer | limit | parts | noise | seconds | met |")
    print("|---|---|---|---|---|---|---|---|---|")
    source = scans(options.folder, options.n) if options.folder else generated(options.n)
    for name, points, truth in source:
        if options.only in name:
            for row in measure(name, points, truth, steps):
                print(row, flush=True)


if __name__ == "__main__":
    main()
