"""Odd options, signals and too little memory: what becomes of calls and of commands.

Everything is seeded: a line of the log names the case, which ``--only CAMPAIGN NUMBER`` runs again.
The table counts what must not be: crashes, hangs, files left behind, errors of other kinds.
"""

from __future__ import annotations

import argparse
import contextlib
import inspect
import io
import os
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from odd_values import FLAGS, GOOD, KINDS, ODD, WORDS, pick, sphere

from o3d_sofnn.compare import isolated

HANG = 60.0
"""Seconds after which a call on some hundred points counts as hanging."""
BATCH = 50
"""Calls in one process."""
FINE = ("done", "ValueError", "MemoryError", "PyMeshLabException", "exit 1", "exit 2", "signal")
"""Ends that may be."""


def option_call(rng: np.random.Generator) -> str:
    """Call an operator with one to three options, most of them odd; return how it ended."""
    import open3d as o3d

    import o3d_sofnn

    points = sphere(rng)
    if rng.random() < 0.5:
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        cloud.normals = o3d.utility.Vector3dVector(points)
    else:
        cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(points.astype(pick(rng, ("f4", "f8")))))
        cloud.point["normals"] = o3d.core.Tensor(points)
        cloud.point["colors"] = o3d.core.Tensor(np.full((60, 3), 7, pick(rng, ("u1", "u2", "f4"))))
    normals = rng.random() < 0.4
    operator = o3d_sofnn.estimate_normals if normals else o3d_sofnn.reconstruct_surface
    _, *names = inspect.signature(operator).parameters
    chosen = map(str, rng.choice(names, rng.integers(1, 4), replace=False))
    options = {name: pick(rng, ODD if rng.random() < 0.7 else GOOD[name]) for name in chosen}
    with warnings.catch_warnings(), contextlib.redirect_stderr(io.StringIO()):
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", o3d_sofnn.ReconstructionWarning)
        try:
            operator(cloud, **options)
        except ValueError as error:
            named = "|".join([*options, "points ", "pcd"])
            message = str(error)
            if not re.match(named, message) or "\n" in message or len(message) > 400:
                return f"ValueError without a name: {message[:200]!r}"
            return "ValueError"
    return "done"


def command_call(rng: np.random.Generator, folder: Path) -> str:
    """Run a command line of odd arguments in this process; return how it ended."""
    from o3d_sofnn.cli import main

    scan = folder / "scan.xyz"
    np.savetxt(scan, sphere(rng))
    command = pick(rng, ("normals", "reconstruct", "compare", "polish"))
    files = [str(scan), pick(rng, (str(folder / "out.ply"), str(folder / "out"), "", str(folder)))]
    words = [
        word
        for _ in range(rng.integers(0, 4))
        for word in (pick(rng, FLAGS), *(pick(rng, WORDS) for _ in range(rng.integers(0, 4))))
    ]
    if command == "compare":  # of files that are not there: methods have a test of their own
        files = [str(folder / f"{pick(rng, WORDS)}.ply"), "--out", str(folder / "compared")]
    err = io.StringIO()
    before = os.getcwd()
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(err):
            code = main.main([command, *files, *words])
    except SystemExit as stop:
        code = stop.code
    finally:
        os.chdir(before)
    errors = [line for line in err.getvalue().splitlines() if "error: " in line]
    if left_behind(folder):
        return "left a file"
    if errors and errors[-1].endswith(" files failed"):
        errors = errors[:1]  # a line for each of them
    if code in (1, 2) and command != "compare" and len(errors) != 1:
        return f"exit {code} with {len(errors)} lines: {err.getvalue()[:200]!r}"
    return "done" if code == 0 else f"exit {code}"


def filter_call(rng: np.random.Generator) -> str:
    """Apply a filter to a layer with odd parameters; return how it ended."""
    import meshlab_sofnn
    import pymeshlab
    from meshlab_sofnn.parameters import PARAMETERS

    meshlab_sofnn.register(plugin=False)
    meshes = pymeshlab.MeshSet(verbose=False)
    points = sphere(rng) * pick(rng, (1.0, 1.0, 1.0, 0.0, 1e-30, 1e30))
    points[0] = pick(rng, (points[0], points[0], (np.nan, 0, 0)))
    meshes.add_mesh(pymeshlab.Mesh(points[: pick(rng, (60, 60, 60, 3, 1))]))
    name = pick(rng, list(PARAMETERS))
    chosen = rng.choice(np.array(PARAMETERS[name]), rng.integers(1, 4), replace=False)
    odd = [*ODD, pymeshlab.PercentageValue(5.0), pymeshlab.PercentageValue(1e-30)]
    odd += [pymeshlab.PureValue(value) for value in (0.2, -1.0, 1e38, float("nan"), float("inf"))]
    good = {**KINDS, "length": (pymeshlab.PureValue(0.2), pymeshlab.PercentageValue(9.0))}
    values = {
        parameter.name: pick(rng, odd if rng.random() < 0.5 else good[parameter.kind])
        for parameter in chosen
    }
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            meshes.apply_filter(name, **values)
        except pymeshlab.PyMeshLabException:
            return "PyMeshLabException"
    return "done"


def left_behind(folder: Path) -> list[Path]:
    """Return the temporary files that a command has left."""
    return list(folder.rglob("*.part"))


def signal_run(rng: np.random.Generator, folder: Path) -> str:
    """Send a command one or two signals at random times; return how it ended."""
    np.savetxt(folder / "scan.xyz", sphere(rng, 3000))
    output = folder / pick(rng, ("out.ply", "点" * 83 + ".ply"))
    output.write_bytes(b"old")
    command = pick(rng, ("normals", "reconstruct"))
    number = pick(rng, (signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
    with _started([command, str(folder / "scan.xyz"), str(output)], folder) as process:
        # From the first line of the program on: before, signals are the interpreter's.
        process.stdout.readline()
        time.sleep(rng.uniform(0.0, 4.0))
        process.send_signal(number)
        if rng.random() < 0.3:
            time.sleep(rng.uniform(0.0, 0.1))
            process.send_signal(number)
        try:
            _, err = process.communicate(timeout=HANG)
        except subprocess.TimeoutExpired:
            process.kill()
            return "hang"
    if left_behind(folder):
        return "left a file"
    whole = output.read_bytes()
    if whole != b"old" and not whole.startswith(b"ply"):
        return "half a file"
    if process.returncode == 0:
        return "done"
    if process.returncode == -number and whole != b"old" and not err:
        return "done"  # all was done, and the interpreter about to end
    if process.returncode != 128 + number or err.count("\n") != 1 or whole != b"old":
        return f"exit {process.returncode} after {number}: {err[-200:]!r}"
    return "signal"


def memory_run(rng: np.random.Generator, folder: Path) -> str:
    """Run a command with too little memory; return how it ended."""
    np.savetxt(folder / "scan.xyz", sphere(rng, 20_000))
    command = pick(rng, ("normals", "reconstruct"))
    limit = int(rng.uniform(0.45, 0.9) * 2**30)
    arguments = [command, str(folder / "scan.xyz"), str(folder / "out.ply")]
    with _started(arguments, folder, memory=limit) as process:
        try:
            _, err = process.communicate(timeout=3 * HANG)
        except subprocess.TimeoutExpired:
            process.kill()
            return f"hang with {limit >> 20} MB"
    code = process.returncode
    if left_behind(folder):
        return "left a file"
    if code == 0:
        return "done"
    # NumPy's linear algebra ends the process itself, with a line of its own.
    if code == 1 and err.count("\n") == 1 and err.startswith(("o3d-sofnn: ", "OpenBLAS error: ")):
        return "exit 1"
    return f"exit {code} with {limit >> 20} MB: {err[-300:]!r}"


def _started(
    arguments: list[str], folder: Path, memory: int | None = None
) -> subprocess.Popen[str]:
    def prepare() -> None:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if memory is not None:
            resource.setrlimit(resource.RLIMIT_AS, (memory, memory))

    return subprocess.Popen(
        [sys.executable, "-m", "o3d_sofnn", *arguments, "--progress", "plain"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        preexec_fn=prepare,
    )


CAMPAIGNS: dict[str, Callable[..., str]] = {
    "options": option_call,
    "filters": filter_call,
    "commands": command_call,
    "signals": signal_run,
    "memory": memory_run,
}
IN_PROCESS = ("options", "filters", "commands")
"""Those that run many cases in one process."""


def end_of(campaign: str, seed: int, number: int) -> str:
    """Run one case; return how it ended, "Kind: message" for an error that must not be."""
    rng = np.random.default_rng([seed, list(CAMPAIGNS).index(campaign), number])
    run = CAMPAIGNS[campaign]
    with tempfile.TemporaryDirectory() as folder:
        if campaign not in ("options", "filters"):
            run = partial(run, folder=Path(folder))
        try:
            return run(rng)
        except MemoryError:
            return "MemoryError"
        except Exception as error:
            return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"


def ends_of(campaign: str, seed: int, numbers: range) -> list[str]:
    """Run some cases one after the other."""
    return [end_of(campaign, seed, number) for number in numbers]


def ends(campaign: str, seed: int, count: int) -> Iterator[tuple[int, str]]:
    """Yield number and end of every case; a process that dies is repeated case by case."""
    if campaign not in IN_PROCESS:
        for number in range(count):
            yield number, end_of(campaign, seed, number)
        return
    for first in range(0, count, BATCH):
        numbers = range(first, min(first + BATCH, count))
        found = isolated.call(ends_of, campaign, seed, numbers, timeout=HANG * 5)
        if found.error is None:
            yield from zip(numbers, found.value, strict=True)
            continue
        for number in numbers:
            alone = isolated.call(end_of, campaign, seed, number, timeout=HANG)
            yield number, alone.value or alone.error.replace("stopped", "hang: stopped")


def main() -> int:
    """Run the campaigns, and print the table; 1 when something was not as it must be."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    for campaign, count in zip(CAMPAIGNS, (2000, 1000, 1000, 200, 100), strict=True):
        parser.add_argument(f"--{campaign}", type=int, default=count, metavar="N")
    parser.add_argument("--only", nargs=2, metavar=("CAMPAIGN", "NUMBER"), help="run one case")
    args = parser.parse_args()
    if args.only:
        print(end_of(args.only[0], args.seed, int(args.only[1])))
        return 0
    table = ["| campaign | runs | how they ended | not as it must be |", "|---|---|---|---|"]
    wrong = 0
    for campaign in CAMPAIGNS:
        counts: Counter[str] = Counter()
        for number, end in ends(campaign, args.seed, getattr(args, campaign)):
            counts[end if end in FINE else "wrong"] += 1
            if end not in FINE:
                print(f"{campaign} {number}: {end}", flush=True)
        bad = counts.pop("wrong", 0)
        wrong += bad
        ended = ", ".join(f"{count} {end}" for end, count in counts.most_common())
        table.append(f"| {campaign} | {counts.total() + bad} | {ended} | {bad} |")
    print("\n".join(table))
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
