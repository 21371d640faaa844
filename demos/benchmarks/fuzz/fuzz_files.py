"""Damaged files of every format: read, refused in one line, or what should never be.

Valid files are damaged at random (seeded) and read in processes that may die. Counted are: "read",
"refused" (a ValueError of one line that names the file), and everything else: a dead process, more
than 10 s, more than the memory limit, another exception, a second reading that differs, points that
the file has no room for or that were not there before the file was cut. A sample goes through the
command line, which must end with code 0, or 2 and one line.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fuzz_seeds
import numpy as np

from o3d_sofnn import validation
from o3d_sofnn.cli import main as command_line
from o3d_sofnn.files import point_files

SECONDS, MEMORY = 10.0, 2**30
"""What a reader may take; beside what Python and NumPy take."""
BASE_MEMORY = 2**30
PER_PROCESS = 400
"""Files that one process reads before the next one starts."""
NUMBERS = [b"-1", b"0", b"1e999", b"nan", b"4294967295", b"4294967296", b"9223372036854775807"]
NUMBERS += [b"18446744073709551615", b"9" * 400, b"0x10", b"1_000", b"1,5", b"."]
WORDS = [b"\0" * 4, b"\xff" * 4, b"\0\0\0\x80", b"\xff\xff\xff\x7f", b"\0" * 8, b"\xff" * 8]
WORDS += [b"\0" * 7 + b"\x80", b"\x01" + b"\0" * 7, b"\0\0\xf0\x7f"]
MOST_SHOWN = 40
GOOD = ("read", "refused")


def main() -> int:
    """Damage, read, count; the exit code is 0 if nothing happened that should not."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--files", type=int, default=10_000, help="damaged files to make")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--broken", type=Path, help="a folder of more damaged files")
    parser.add_argument("--commands", type=int, default=50, help="files for the command line too")
    parser.add_argument("--keep", type=Path, help="where to copy files that show a fault")
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.worker:
        return worker()
    with tempfile.TemporaryDirectory() as folder:
        tasks = list(damaged(Path(folder), args.files, random.Random(args.seed)))
        if args.broken:
            found = [
                p for p in sorted(args.broken.iterdir()) if p.suffix in point_files.CLOUD_INPUTS
            ]
            tasks += [{"path": str(path), "kind": "given"} for path in found]
        outcomes = list(read_all(tasks))
        sample = random.Random(args.seed).sample(tasks, min(args.commands, len(tasks)))
        commands = [(task, run_command(task, Path(folder))) for task in sample]
        report(outcomes, commands)
        faults = [pair for pair in [*outcomes, *commands] if pair[1].split(":")[0] not in GOOD]
        for task, outcome in faults[:MOST_SHOWN]:
            print(f"{Path(task['path']).name} ({task['kind']}): {outcome}")
            if args.keep:
                args.keep.mkdir(exist_ok=True)
                (args.keep / Path(task["path"]).name).write_bytes(Path(task["path"]).read_bytes())
    return 1 if faults else 0


def damaged(folder: Path, count: int, rng: random.Random) -> Iterator[dict[str, Any]]:
    """Write damaged copies of the seeds, each format as often as the others, and yield tasks."""
    seeds = folder / "seeds"
    seeds.mkdir()
    made = fuzz_seeds.make(seeds)
    valid = {path: path.read_bytes() for path in made}
    for i in range(count):
        seed = made[i % len(made)]
        kind = rng.choice([*KINDS])
        data = KINDS[kind](valid[seed], rng)
        ending = seed.suffix
        if ending == ".e57" and rng.random() < 0.7:
            data = fuzz_seeds.with_checksums(data)
        if kind == "other ending":  # but for that of Open3D, which takes seconds to start
            ending = rng.choice(sorted(point_files.CLOUD_INPUTS - {".fbx"}))
        path = folder / f"{i}_{seed.stem}{ending}"
        path.write_bytes(data)
        yield {"path": str(path), "kind": kind, "seed": str(seed)}


def cut(data: bytes, rng: random.Random) -> bytes:
    """End anywhere."""
    return data[: rng.randrange(len(data))]


def flip(data: bytes, rng: random.Random, most: int = 8, end: int | None = None) -> bytes:
    """Change up to ``most`` bytes before ``end``."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, most)):
        changed[rng.randrange(len(data[:end]))] = rng.randrange(256)
    return bytes(changed)


def flip_head(data: bytes, rng: random.Random) -> bytes:
    """Change up to three bytes near the beginning, where headers are."""
    return flip(data, rng, 3, 400)


def change_number(data: bytes, rng: random.Random) -> bytes:
    """Put an extreme number in place of one that is written in digits."""
    found = list(re.finditer(rb"-?\d+(?:\.\d+)?", data))
    if not found:
        return flip(data, rng)
    # Half of them among the first, which say how much follows.
    match = rng.choice(found[:12] if rng.random() < 0.5 else found)
    return data[: match.start()] + rng.choice(NUMBERS) + data[match.end() :]


def change_word(data: bytes, rng: random.Random) -> bytes:
    """Put extreme binary numbers anywhere, half of them near the beginning."""
    end = min(len(data), 400) if rng.random() < 0.5 else len(data)
    at, word = rng.randrange(end), rng.choice(WORDS)
    return data[:at] + word + data[at + len(word) :]


def remove(data: bytes, rng: random.Random) -> bytes:
    """Leave out a piece."""
    at = rng.randrange(len(data))
    return data[:at] + data[at + rng.randint(1, 100) :]


def repeat(data: bytes, rng: random.Random) -> bytes:
    """Have a piece twice."""
    at = rng.randrange(len(data))
    return data[:at] + data[at : at + rng.randint(1, 500)] + data[at:]


def insert(data: bytes, rng: random.Random) -> bytes:
    """Have random bytes in between."""
    at = rng.randrange(len(data))
    return data[:at] + rng.randbytes(rng.randint(1, 50)) + data[at:]


def keep(data: bytes, rng: random.Random) -> bytes:
    """Change nothing."""
    return data


KINDS = {
    "cut": cut,
    "flipped bytes": flip,
    "flipped header": flip_head,
    "extreme digits": change_number,
    "extreme binary": change_word,
    "piece missing": remove,
    "piece twice": repeat,
    "bytes inserted": insert,
    "other ending": keep,
    "whole": keep,
}


def read_all(tasks: list[dict[str, Any]]) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield tasks with what became of them; a dead process costs one file."""
    left = tasks[::-1]
    while left:
        command = [sys.executable, __file__, "--worker"]
        pipe = subprocess.PIPE
        with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            for _ in range(min(PER_PROCESS, len(left))):
                task = left.pop()
                print(json.dumps(task), file=process.stdin, flush=True)
                line = process.stdout.readline()
                if not line:
                    process.wait()
                    yield task, f"dead process: code {process.returncode}"
                    break
                yield task, json.loads(line)
            process.stdin.close()
            process.wait(timeout=60)


def worker() -> int:
    """Read the files that come by the standard input stream, and say what became of each."""
    limit = BASE_MEMORY + MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    for line in sys.stdin:
        print(json.dumps(outcome_of(json.loads(line))), flush=True)
    return 0


def outcome_of(task: dict[str, Any]) -> str:
    """Return "read", "refused", or what is wrong."""
    path = Path(task["path"])
    # A reader that never ends is ended by the system, with the process.
    used = time.process_time()
    resource.setrlimit(resource.RLIMIT_CPU, (int(used + SECONDS) + 2, resource.RLIM_INFINITY))
    started = time.perf_counter()
    try:
        file = point_files.read_points(path)
    except ValueError as error:
        said = str(error)
        fine = said.startswith(str(path)) and "\n" not in said and type(error) is ValueError
        return "refused" if fine else f"message: {type(error).__name__} {said[:200]!r}"
    except Exception as error:  # any other is a fault, and the fuzzer goes on
        return f"exception: {type(error).__name__} {str(error)[:200]!r}"
    seconds = time.perf_counter() - started
    if seconds > SECONDS:
        return f"slow: {seconds:.0f} s"
    return fault_of(file, task) or "read"


def fault_of(file: point_files.PointFile, task: dict[str, Any]) -> str | None:
    """Return what is wrong with the contents of a file."""
    count = len(file.points)
    stored = [file.points, *file.attributes.values()]
    stored += [] if file.normals is None else [file.normals]
    if any(len(values) != count or values.ndim != 2 for values in stored):
        return "shapes: of different lengths"
    if file.viewpoint is not None and file.viewpoint.shape not in ((3,), (count, 3)):
        return f"shapes: viewpoint {file.viewpoint.shape}"
    if file.shape is not None and file.shape[0] * file.shape[1] != count:
        return f"shapes: {file.shape} for {count} points"
    path = Path(task["path"])
    again = point_files.read_points(path)
    if not all(map(same, stored, [again.points, *again.attributes.values(), again.normals])):
        return "differs: when read again"
    before = point_files.read_points(task["seed"]).points if "seed" in task else None
    packed = path.suffix in (".laz", ".npz", ".e57", ".gltf", ".glb") and before is not None
    room = 2 * len(before) if packed else path.stat().st_size // 3
    if count > room:
        return f"invented: {count} points in {path.stat().st_size} bytes"
    is_cut = task["kind"] == "cut" and before is not None
    if is_cut and count >= validation.MIN_POINTS and not same(file.points, before[:count]):
        return "invented: other points in a file cut short"
    if task["kind"] == "whole" and before is not None and not same(file.points, before):
        return "lost: points of a whole file"
    return None


def same(one: Any, other: Any) -> bool:
    """Return whether two arrays have the same bits."""
    return (
        one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    )


def run_command(task: dict[str, Any], folder: Path) -> str:
    """Return what became of a file on the command line."""
    out = folder / "out.ply"
    process = subprocess.run(
        [sys.executable, "-m", "o3d_sofnn", "normals", task["path"], str(out)],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    errors = [line for line in process.stderr.splitlines() if "WARNING" not in line]
    if process.returncode == 0 and not errors:
        return "read"
    if process.returncode == command_line.BAD_INPUT and len(errors) == 1:
        return "refused"
    return f"command: code {process.returncode}, {process.stderr[-300:]!r}"


def report(
    outcomes: list[tuple[dict[str, Any], str]], commands: list[tuple[dict[str, Any], str]]
) -> None:
    """Print a row for each format, and one for the command line."""
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for task, outcome in outcomes:
        kind = outcome.split(":")[0]
        table[Path(task["path"]).suffix][kind if kind in GOOD else "faults"] += 1
    total: Counter[str] = sum(table.values(), Counter())
    by_command = Counter("faults" if o.split(":")[0] not in GOOD else o for _, o in commands)
    print("| format | files | read | refused in one line | anything else |\n|---|---|---|---|---|")
    rows = [*sorted(table.items()), ("all", total), ("by the command line", by_command)]
    for name, counts in rows:
        cells = [name, sum(counts.values()), *(counts[k] for k in ("read", "refused", "faults"))]
        print(f"| {' | '.join(map(str, cells))} |")


if __name__ == "__main__":
    np.seterr(all="raise")
    sys.exit(main())
