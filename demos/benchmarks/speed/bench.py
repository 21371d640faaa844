"""Time and memory of our operators and of their peers, in turn, each run in a process of its own.

Clouds are sampled from a tooth crown with 0.1 % noise, or read from files. Every measurement goes
into a file at once: a second call goes on where the first one stopped, so that the whole benchmark
can be done in calls of a few minutes. The table is Markdown.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any

import demos_path  # noqa: F401
import numpy as np
from bench_table import table
from bench_tasks import TASKS
from numpy.typing import NDArray
from paper_parts.dental_shapes import molar

from o3d_sofnn.compare.isolated import call

SIZES = {"3714": 3714, "6179": 6179, "100k": 100_000, "400k": 400_000, "1M": 1_000_000}
LARGE = {"3M": 3_000_000, "5M": 5_000_000, "10M": 10_000_000}
NOISE = 1e-3
"""Standard deviation of the noise, divided by the diagonal of the bounding box."""
MARGIN = 1.1
"""Edge of the cube that Poisson divides, as a multiple of the bounding box: its own default."""
AGREE = 0.2
"""Largest relative difference of the numbers of triangles, ours and Poisson's."""
SLOW = 60.0
"""Measurements that take longer than this, in seconds, are not repeated."""
TIMEOUT = 500.0
"""Seconds after which a measurement is given up."""
TUNING, TRIES = "tuning", 3
"""Name of Poisson runs with another number of triangles, and how many there may be."""

Record = dict[str, Any]


def main() -> None:
    """Measure what is missing until the time is used up, then print the table."""
    options = _options()
    folder = Path(options.out)
    folder.mkdir(parents=True, exist_ok=True)
    log = Log(folder / "bench.jsonl")
    deadline = time.monotonic() + options.budget
    clouds = [_cloud(folder, name) for name in options.sizes]
    clouds += [_read(folder, Path(file)) for file in options.files]
    missing = 0
    for repeat in range(options.repeats):
        for cloud in clouds:
            for task in _tasks(options, cloud):
                if log.enough(cloud.name, task, repeat):
                    continue
                left = deadline - time.monotonic()
                expected = log.expected(cloud.name, task)
                if left < expected or not log.measure(cloud, task, min(left + 30.0, TIMEOUT)):
                    missing += 1
    text = table(log.records)
    (folder / "bench.md").write_text(text)
    print(text)
    if missing:
        print(f"{missing} measurements are missing: call again with the same arguments.")


class Cloud:
    """A file of points, and beside it their normals where they are known."""

    def __init__(self, file: Path) -> None:
        self.file, self.name = file, file.stem
        self.has_normals = file.with_suffix(".normals.npy").exists()

    def __len__(self) -> int:
        """Return the number of points."""
        return len(np.load(self.file, mmap_mode="r"))


class Log:
    """Measurements, one a line, kept from call to call."""

    def __init__(self, file: Path) -> None:
        self.file = file
        lines = file.read_text().splitlines() if file.exists() else []
        self.records: list[Record] = [json.loads(line) for line in lines]

    def of(self, cloud: str, task: str) -> list[Record]:
        """Return the measurements of one task on one cloud."""
        return [r for r in self.records if r["cloud"] == cloud and r["task"] == task]

    def enough(self, cloud: str, task: str, repeat: int) -> bool:
        """Whether a task has been measured so often already, or is too slow to be repeated."""
        done = self.of(cloud, task)
        slow = any(r.get("error") or r["seconds"] > SLOW for r in done)
        return len(done) > repeat or (slow and repeat > 0)

    def expected(self, cloud: str, task: str) -> float:
        """Return the seconds that one more measurement will take."""
        done = [r["seconds"] for r in self.of(cloud, task)]
        return 5.0 + 1.5 * (median(done) if done else 0.0)

    def grid(self, cloud: str) -> NDArray[np.float64]:
        """Depth and margin with which Poisson gives as many triangles as we do."""
        ours = self.of(cloud, "ours_mesh")
        if not ours or "cubes" not in ours[-1]:
            return np.array([9.0, MARGIN])
        cubes = ours[-1]["cubes"]
        tries = [r for r in self.of(cloud, "open3d_poisson") + self.of(cloud, TUNING) if r["cubes"]]
        for last in [r for r in tries if "triangles" in r][-1:]:
            off = last["triangles"] / ours[-1]["triangles"]
            cubes = last["cubes"] / (1.0 if abs(off - 1.0) <= AGREE else np.sqrt(off))
        depth = int(np.ceil(np.log2(cubes * MARGIN)))
        return np.array([depth, 2.0**depth / cubes])

    def measure(self, cloud: Cloud, task: str, timeout: float) -> bool:
        """Run one task and write down what came of it; False when the time ran out."""
        for _ in range(TRIES):
            grid = self.grid(cloud.name)
            print(f"{cloud.name} {task} ...", end=" ", flush=True)
            outcome = call(TASKS[task], str(cloud.file), grid, timeout=timeout)
            if outcome.error and timeout <= outcome.seconds and timeout < TIMEOUT:
                print("no time left", flush=True)
                return False
            record: Record = {"cloud": cloud.name, "points": len(cloud), "task": task}
            record |= {"seconds": outcome.seconds, "peak_mb": outcome.peak_mb}
            record |= {"error": outcome.error, "cubes": 2.0 ** grid[0] / grid[1]}
            record |= outcome.value or {}
            ours = [r for r in self.of(cloud.name, "ours_mesh") if "triangles" in r]
            tuned = task != "open3d_poisson" or not ours or "triangles" not in record
            tuned = tuned or abs(record["triangles"] / ours[-1]["triangles"] - 1.0) <= AGREE
            print(outcome.error or f"{record['seconds']:.2f} s", flush=True)
            if not tuned:
                record["task"] = TUNING
            self.records.append(record)
            with self.file.open("a") as stream:
                stream.write(json.dumps(record) + "\n")
            if tuned:
                return True
        return True


def _tasks(options: argparse.Namespace, cloud: Cloud) -> Iterator[str]:
    for task in options.tasks or TASKS:
        if task == "open3d_poisson" and not cloud.has_normals:
            continue
        # Orientation along tangent planes takes many minutes on large clouds.
        if task in ("open3d_chain", "meshlab_chain") and len(cloud) > options.chain:
            continue
        yield task


def _cloud(folder: Path, name: str) -> Cloud:
    file = folder / f"crown_{name}.npy"
    if not file.exists():
        count = (SIZES | LARGE)[name]
        tooth = molar()
        clean = tooth.sample(count)
        diagonal = float(np.linalg.norm(np.ptp(clean, axis=0)))
        noise = np.random.default_rng(1).normal(0.0, NOISE * diagonal, clean.shape)
        np.save(file.with_suffix(".normals.npy"), tooth.normals(clean))
        np.save(file, clean + noise)
    return Cloud(file)


def _read(folder: Path, source: Path) -> Cloud:
    import open3d as o3d

    file = folder / f"{source.stem}.npy"
    if not file.exists():
        points = np.asarray(o3d.io.read_point_cloud(str(source)).points)
        if not len(points):
            raise SystemExit(f"{source}: no points")
        np.save(file, points)
    return Cloud(file)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", help="clouds to measure beside the generated ones")
    names = [*SIZES, *LARGE]
    parser.add_argument("--sizes", nargs="*", choices=names, default=list(SIZES))
    parser.add_argument("--tasks", nargs="*", choices=TASKS, help="default: all")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--budget", type=float, default=540.0, help="seconds for this call")
    parser.add_argument(
        "--chain", type=int, default=1_000_000, help="largest cloud for the chains of the peers"
    )
    parser.add_argument("--quick", action="store_true", help="3714 and 100k, once")
    parser.add_argument("--out", default="build/bench", help="folder of clouds and measurements")
    options = parser.parse_args()
    if options.quick:
        options.sizes, options.repeats = ["3714", "100k"], 1
    return options


if __name__ == "__main__":
    main()
