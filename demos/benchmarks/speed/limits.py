"""How far each stage is from what the machine allows: bytes and flops counted, limits measured.

The limits are the bandwidth of a large copy and the rate of a matrix product, both on all cores.
Bytes are those of the arrays a stage has to read and write if everything else stays in the caches;
flops those of its kernels, counted in their source (a multiplication with an addition is two).
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from typing import Any, NamedTuple

import demos_path  # noqa: F401
import numpy as np
from numpy.typing import NDArray
from paper_parts.dental_shapes import molar

from o3d_sofnn import pipeline
from o3d_sofnn.implicit.far_field import PLACES
from o3d_sofnn.implicit.field import NEAREST
from o3d_sofnn.orientation.winding_normals import NARROWING, OPENING, ROUNDS, STEPS
from o3d_sofnn.sampling.representatives import representatives
from o3d_sofnn.sampling.scales.choice import PILOTS, SCALES

Array = NDArray[Any]

NOISE = 1e-3
"""Over the diagonal."""
SEARCH = 2.2 * 8
"""Flops of a search for each neighbour found: distances of the candidates."""
FIT = 45 + 81
"""Flops of one fit for each point in it: weights and plane, turn; sums, solution, residuals."""
PASSES = 3 * (81 + 28)
"""The same for the passes with weights in the residual."""
RULE = 95
"""Flops of one rule at one place."""
RULES = 12
SOURCES = 550 * (0.5 / OPENING) ** 2
"""Nodes and points that the tree code sums for one place; counted once at the opening of 1/2."""
SUMS = 2 * ROUNDS * STEPS + 4 * (1 + NARROWING)
"""Sums over all representatives: two a step of conjugate gradients, four an iteration."""
PAIR = 25
"""Flops for each of them."""
POINT = 24
"""Bytes of a point or a normal."""


class Work(NamedTuple):
    """What a stage has to do at least."""

    bytes: float
    flops: float
    single: bool = False


def main() -> None:
    """Measure the machine, run a reconstruction, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    tooth = molar().sample(options.points)
    noise = NOISE * float(np.linalg.norm(np.ptp(tooth, axis=0)))
    points = tooth + np.random.default_rng(1).normal(0.0, noise, tooth.shape)
    copy, double, single = bandwidth(), products(np.float64), products(np.float32)
    runs = [pipeline.reconstruct_surface(points) for _ in range(options.repeats)]
    print(
        f"{cpu_count()} cores: {copy / 1e9:.1f} GB/s, {double / 1e9:.0f} Gflop/s double, "
        f"{single / 1e9:.0f} single; {options.points} points, {len(runs[0].triangles)} triangles\n"
    )
    print(
        "| stage | MB | Gflop | bandwidth allows, s | flops allow, s | takes, s | limit reached |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for stage, work in count(points, runs[0]).items():
        seconds = float(np.median([run.seconds[stage] for run in runs]))
        by_bytes, by_flops = work.bytes / copy, work.flops / (single if work.single else double)
        print(
            f"| {stage} | {work.bytes / 1e6:.0f} | {work.flops / 1e9:.2f} | {by_bytes:.3f} "
            f"| {by_flops:.3f} | {seconds:.3f} | {max(by_bytes, by_flops) / seconds:.2f} |"
        )


def count(points: Array, run: pipeline.SurfaceEstimate) -> dict[str, Work]:
    """Count the work of every stage from what came out of it."""
    n, rules = len(points), run.normals.rules
    fitted = float(rules.n_neighbors.sum())
    vertices = len(run.vertices)
    pilots = float(PILOTS * SCALES.sum())
    fits = fitted * (SEARCH + FIT + PASSES)
    infer = Work(n * 3.7 * POINT, n * RULES * RULE)
    unknowns = len(representatives(points, 0.0, 1.0)[0])
    winding = SUMS * unknowns * SOURCES * PAIR
    # Corners of the cubes around the surface: twice as many as vertices, which are evaluated again.
    corners = 2.0 * vertices
    field = (corners + vertices) * (NEAREST * (RULE + 30) + SOURCES * PAIR)
    return {
        # Keys, six passes over pairs of key and index, points in their new order.
        "cells": Work(n * (POINT + 6 * 32 + 2 * POINT), n * 20.0),
        # Points once for the tree, once for the outliers.
        "scale": Work(n * 5.0 * POINT, 2.0 * pilots * (SEARCH / SCALES.size + FIT) + n * 16.0 * 8),
        "orientation": Work(n * 2.0 * POINT, winding + n * float(SOURCES * PAIR), single=True),
        "typical data": Work(n * 4.0 * POINT, n * 4 * 8 * 12.0),
        "rules": Work(n * 2.0 * POINT, fits),
        # Inference twice as much: once for the normals, once for the errors of the consequents.
        "growth": Work(2.0 * infer.bytes + n * 2.0 * POINT, fits + 2.0 * infer.flops),
        "inference": Work(2.0 * infer.bytes, infer.flops),
        "local surfaces": Work(infer.bytes + n * 2.0 * POINT, infer.flops + 6.0 * fitted * 20),
        "field": Work(n * 6.0 * POINT, min(n, PLACES) * float(SOURCES * PAIR), single=True),
        "surface": Work(corners * 3 * POINT + vertices * 12.0 * POINT, field),
        "attributes": Work(vertices * 6.0 * POINT, vertices * RULES * float(RULE)),
    }


def bandwidth() -> float:
    """Bytes read and written in a second by copies of 256 MB, the best of five."""
    workers = cpu_count() or 1
    source = [np.ones(2**25) for _ in range(workers)]
    target = [np.empty_like(part) for part in source]
    best = np.inf
    with ThreadPoolExecutor(workers) as pool:
        for _ in range(5):
            started = time.perf_counter()
            list(pool.map(np.copyto, target, source))
            best = min(best, time.perf_counter() - started)
    return 2.0 * sum(part.nbytes for part in source) / best


def products(kind: type) -> float:
    """Flops in a second of a matrix product, the best of five."""
    size = 2048
    a = np.ones((size, size), kind)
    best = np.inf
    for _ in range(5):
        started = time.perf_counter()
        a @ a
        best = min(best, time.perf_counter() - started)
    return 2.0 * size**3 / best


if __name__ == "__main__":
    main()
