"""Whether more points with the same noise make normals worse: ``python dense.py``.

Clouds of an icosahedron and a cylinder with noise along each axis, in percent of the diagonal of
their box: all points, and the first of them only. Beside it, planes and quadrics through the best
of several fixed numbers of neighbours. Angles, either side, are against the face a point came from.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from o3d_sofnn._kernels import KdTree, fit_scales
from o3d_sofnn.geometry.mesh_properties import normal_angles
from o3d_sofnn.pipeline import estimate_normals

Array = NDArray[Any]

SIZES = np.array([18, 112, 450, 1350])
"""Numbers of neighbours of the planes and quadrics."""
PLACES = 5000
"""Points at which these are fitted."""


def main() -> int:
    """Print a line for each cloud."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, nargs="+", default=[100_000, 40_000, 20_000, 10_000])
    parser.add_argument("--noise", type=float, nargs="+", default=[0.6, 1.2])
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    print(
        "| shape | noise | points | ours | flipped | noise found | rules | CPU s "
        "| quadric | plane |"
    )
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|")
    for name, make in (("icosahedron", icosahedron), ("cylinder", cylinder)):
        for noise in options.noise:
            rng = np.random.default_rng(options.seed)
            clean, normals = make(max(options.n), rng)
            diagonal = float(np.linalg.norm(np.ptp(clean, axis=0)))
            points = clean + rng.normal(0.0, noise / 100.0 * diagonal, clean.shape)
            for n in options.n:
                report(f"{name} | {noise:g} %", points[:n], normals[:n], diagonal)
    return 0


def report(name: str, points: Array, normals: Array, diagonal: float) -> None:
    """Print the line of one cloud."""
    begin = time.process_time()
    found = estimate_normals(points)
    seconds = time.process_time() - begin
    flipped = (np.einsum("nd,nd->n", found.normals, normals) < 0.0).mean()
    some = np.random.default_rng(1).choice(len(points), min(PLACES, len(points)), replace=False)
    places = np.ascontiguousarray(points[some])
    quadrics = fit_scales(KdTree(points, -1), points, places, SIZES)[0]
    best = min(rms(quadrics[:, i], normals[some]) for i in range(len(SIZES)))
    plane = min(rms(planes(points, places, size), normals[some]) for size in SIZES)
    print(
        f"| {name} | {len(points)} | {rms(found.normals, normals):.1f} | {100 * flipped:.2f} % "
        f"| {100 * found.noise_level / diagonal:.2f} % | {len(found.rules)} | {seconds:.1f} "
        f"| {best:.1f} | {plane:.1f} |",
        flush=True,
    )


def rms(found: Array, normals: Array) -> float:
    """Root-mean-square angle in degrees."""
    return float(np.sqrt(np.mean(normal_angles(found, normals) ** 2)))


def planes(points: Array, places: Array, size: int) -> Array:
    """Fit a plane through the nearest points of each place, (p, 3)."""
    near = np.asarray(KdTree(points, -1).query(places, size, np.inf)[1])
    normals = np.empty_like(places)
    for first in range(0, len(places), 500):
        x = points[near[first : first + 500]]
        x = x - x.mean(axis=1, keepdims=True)
        scatter = np.einsum("pki,pkj->pij", x, x)
        normals[first : first + 500] = np.linalg.eigh(scatter)[1][:, :, 0]
    return normals


def icosahedron(n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw points evenly from a regular icosahedron."""
    golden = (1.0 + 5.0**0.5) / 2.0
    corners = np.array(
        [
            np.roll([0.0, one, two * golden], turn)
            for turn in range(3)
            for one in (-1.0, 1.0)
            for two in (-1.0, 1.0)
        ]
    )
    hull = ConvexHull(corners)
    face = rng.integers(0, len(hull.simplices), n)
    a, b, c = np.moveaxis(corners[hull.simplices[face]], 1, 0)
    u, v = rng.random((2, n, 1))
    root = np.sqrt(u)
    return (1.0 - root) * a + root * (1.0 - v) * b + root * v * c, hull.equations[face, :3]


def cylinder(n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw points evenly from a closed cylinder four radii high."""
    angle, height = rng.uniform(0.0, 2.0 * np.pi, n), rng.uniform(-2.0, 2.0, n)
    radius = np.ones(n)
    side = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    lid = rng.random(n) < 0.2  # two lids of pi beside a mantle of 8 pi
    radius[lid] = np.sqrt(rng.random(n)[lid])
    height[lid] = 2.0 * np.sign(height[lid])
    points = radius[:, None] * side + height[:, None] * [0.0, 0.0, 1.0]
    up = np.sign(height)[:, None] * [0.0, 0.0, 1.0]
    return points, np.where(lid[:, None], up, side)


if __name__ == "__main__":
    sys.exit(main())
