"""Fingerprints of results, to compare two commits bit by bit: ``python fingerprints.py FILE ...``.

Prints, for each file, hashes of normals and mesh and the processor time. A closed mesh is sampled
(20,000 points, clean and with 0.5 % noise), any other file is taken as a cloud.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from truth import Case, draw

from o3d_sofnn.pipeline import estimate_normals, reconstruct_surface

Array = NDArray[Any]


def clouds(file: Path, most: int) -> Iterator[tuple[str, Array]]:
    """Yield names and points: samples of a mesh that has triangles, else at most so many points."""
    import open3d as o3d

    mesh = o3d.io.read_triangle_mesh(str(file))
    if len(mesh.triangles):
        for noise in (0.0, 0.5):
            yield f"{file.stem}, {noise:g} %", draw(Case(file, noise=noise)).points
        return
    points = np.asarray(o3d.io.read_point_cloud(str(file)).points)
    points = points[np.isfinite(points).all(axis=1)]
    yield file.stem, np.ascontiguousarray(points[:: -(-len(points) // most)])


def fingerprint(*arrays: Array) -> str:
    """Return the first digits of a hash over the bytes of arrays."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:12]


def main() -> int:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="meshes and clouds")
    parser.add_argument("--most", type=int, default=50_000, help="points of a cloud")
    options = parser.parse_args()
    print("| cloud | points | normals | mesh | CPU seconds |\n|---|---|---|---|---|")
    for file in options.files:
        for name, points in clouds(file, options.most):
            started = time.process_time()
            normals = estimate_normals(points)
            mesh = reconstruct_surface(points)
            print(
                f"| {name} | {len(points)} | {fingerprint(normals.normals, normals.confidence)} | "
                f"{fingerprint(mesh.vertices, mesh.triangles)} | "
                f"{time.process_time() - started:.1f} |",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
