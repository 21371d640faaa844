"""Odd clouds through the operators on arrays: nothing crashes, hangs, warns, or is no number.

Calls are drawn from a seed (`odd_clouds.py`) and run in processes of their own. Each ends with
normals, with a mesh that is what was promised, or with a ValueError that names an argument.
Everything else is a fault, printed with its seed: ``--first SEED --calls 1 --here`` repeats it.
"""

from __future__ import annotations

import argparse
import collections
import concurrent.futures
import os
import re
import subprocess
import sys
import warnings

import numpy as np
import odd_clouds
from numpy.typing import NDArray

from o3d_sofnn import pipeline
from o3d_sofnn._kernels import intersecting_pairs
from o3d_sofnn.geometry import mesh_properties

Array = NDArray[np.float64]
NAMED = re.compile(r"(points|depth|voxel_size|trim|radius|max_nn|precision|target_triangles)\b")
"""How the message of an error begins."""
GOOD = ("normals", "mesh", "open mesh", "ValueError")
SECONDS = 60
"""Processor time, in seconds, after which a call counts as hanging."""
COARSE = 1e-5
"""Rounding error, divided by the edge length, above which triangles may overlap."""
REACH = 1.0
"""Extents that a mesh may reach beyond the inliers."""
BATCH = 200
"""Calls per process; the next process continues after the last call, also if that crashed."""


def main() -> None:
    """Draw calls, make them, print the table; exit code 1 where there is a fault."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first call")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--here", action="store_true", help="in this process, with tracebacks")
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.calls)
    if arguments.here:
        outcomes = {seed: one_call(seed, raising=arguments.calls == 1) for seed in seeds}
    else:
        batches = [seeds[i : i + BATCH] for i in range(0, len(seeds), BATCH)]
        with concurrent.futures.ThreadPoolExecutor(arguments.jobs) as pool:
            found = list(pool.map(run_batch, batches))
        outcomes = {seed: outcome for batch in found for seed, outcome in batch.items()}
    faults = {seed: outcome for seed, outcome in outcomes.items() if outcome not in GOOD}
    print(table(outcomes))
    for seed, outcome in sorted(faults.items()):
        print(f"\nseed {seed} ({odd_clouds.case(seed).kind}): {outcome}")
    sys.exit(1 if faults else 0)


def one_call(seed: int, raising: bool = False) -> str:
    """Make a call and say how it ended."""
    case = odd_clouds.case(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            if case.surface:
                return _mesh_fault(pipeline.reconstruct_surface(case.points, **case.options), case)
            return _normals_fault(pipeline.estimate_normals(case.points, **case.options), case)
        except ValueError as error:
            return "ValueError" if NAMED.match(str(error)) else f"ValueError without name: {error}"
        except Exception as error:
            if raising:
                raise
            return f"{type(error).__name__}: {error}"


def _normals_fault(estimate: pipeline.NormalEstimate, case: odd_clouds.Case) -> str:
    """Say what is wrong with normals; "normals" for nothing."""
    length = np.linalg.norm(estimate.normals, axis=1)
    if estimate.normals.shape != case.points.shape or not (np.abs(length - 1.0) < 1e-6).all():
        return "normals are not unit vectors"
    if not ((estimate.confidence >= 0.0) & (estimate.confidence <= 1.0)).all():
        return "confidence is not from 0 to 1"
    if not ((estimate.noise >= 0.0) & (estimate.noise < np.inf)).all():
        return "noise is not finite"
    return "normals"


def _mesh_fault(found: pipeline.SurfaceEstimate, case: odd_clouds.Case) -> str:
    """Say what is wrong with a mesh; "mesh" or "open mesh" for nothing."""
    fault = _normals_fault(found.normals, case)
    if fault != "normals":
        return fault
    triangles = found.triangles
    if not len(triangles) or not np.isfinite(found.vertices).all():
        return "vertices are not finite"
    if triangles.min() < 0 or triangles.max() >= len(found.vertices):
        return "triangles name vertices that are not"
    length = np.linalg.norm(found.vertex_normals, axis=1)
    if not (np.abs(length - 1.0) < 1e-6).all():
        return "vertex normals are not unit vectors"
    if not mesh_properties.is_edge_manifold(triangles):
        return "mesh is not edge-manifold"
    if not mesh_properties.is_vertex_manifold(triangles):
        return "mesh is not vertex-manifold"
    closed = mesh_properties.is_watertight(triangles)
    if found.watertight != closed:
        return "mesh says of itself what it is not"
    if case.options.get("closed") is True and not closed:
        return "mesh is not closed"
    if not {"depth", "voxel_size"} & case.options.keys() and _is_far_out(found, case):
        return "mesh reaches far beyond the points"
    if closed and _cuts_itself(found.vertices, triangles):
        return "mesh cuts itself"
    return "mesh" if closed else "open mesh"


def _is_far_out(found: pipeline.SurfaceEstimate, case: odd_clouds.Case) -> bool:
    """Whether the mesh reaches much farther beyond the box of the inliers than that is long."""
    inliers = case.points[~found.normals.outliers]
    if not len(inliers):
        return False
    low, high = inliers.min(axis=0), inliers.max(axis=0)
    extent = float((high - low).max())
    beyond = np.maximum(low - found.vertices, found.vertices - high).max()
    return bool(beyond > REACH * extent)


def _cuts_itself(vertices: Array, triangles: NDArray[np.int32]) -> bool:
    """Whether triangles cut others, and not as coordinates far from 0 are too coarse for them."""
    length = np.linalg.norm(vertices[triangles[:, 0]] - vertices[triangles[:, 1]], axis=1)
    if np.spacing(np.abs(vertices).max()) > COARSE * length.mean():
        return False
    everything = np.ones(len(triangles), bool)
    return len(intersecting_pairs(vertices, triangles, everything, 1)) > 0


def run_batch(seeds: range) -> dict[int, str]:
    """Make some calls in a process, and in another one what is left when a call ends it."""
    outcomes: dict[int, str] = {}
    while len(outcomes) < len(seeds):
        first = seeds[len(outcomes)]
        command = [sys.executable, __file__, "--worker", str(first), str(seeds[-1] + 1)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=20 * SECONDS, check=False
            )
            lines, code = done.stdout, done.returncode
        except subprocess.TimeoutExpired as late:  # waits, and takes no processor time
            lines, code = (late.stdout or b"").decode(), -1
        for line in lines.splitlines():
            seed, outcome = line.split("\t")
            outcomes[int(seed)] = outcome
        if len(outcomes) < len(seeds):
            hang = code in (-1, -24)
            outcomes[seeds[len(outcomes)]] = "hang" if hang else f"crash, exit code {code}"
    return outcomes


def work(first: int, end: int) -> None:
    """Make calls and print a line for each as soon as it is done."""
    import resource

    for seed in range(first, end):
        used = resource.getrusage(resource.RUSAGE_SELF)
        limit = int(used.ru_utime + used.ru_stime) + SECONDS
        resource.setrlimit(resource.RLIMIT_CPU, (limit, -1))
        outcome = one_call(seed).replace("\t", " ").replace("\n", " ")
        print(f"{seed}\t{outcome}", flush=True)


def table(outcomes: dict[int, str]) -> str:
    """Count how the calls of each kind of cloud have ended, in Markdown."""
    counts = {kind: collections.Counter[str]() for kind in odd_clouds.KINDS}
    for seed, outcome in outcomes.items():
        counts[odd_clouds.case(seed).kind][outcome if outcome in GOOD else "fault"] += 1
    columns = (*GOOD, "fault")
    lines = [f"| cloud | {' | '.join(columns)} |", f"|---|{'---:|' * len(columns)}"]
    total = sum(counts.values(), collections.Counter[str]())
    for kind, count in [*counts.items(), ("all", total)]:
        lines.append(f"| {kind} | {' | '.join(str(count[column]) for column in columns)} |")
    return "\n".join(lines)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--worker"]:
        work(int(sys.argv[2]), int(sys.argv[3]))
    else:
        main()
