"""Common parts of all demos: options, one line of progress per job, and contained failures."""

from __future__ import annotations

import argparse
import contextlib
import csv
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent

Job = Callable[[], None]
"""Does a part of a demo and prints the result; raises an exception if it fails."""


def parser(
    description: str, name: str, timeout: float, docs: str | None = None
) -> argparse.ArgumentParser:
    """Return a parser with the options ``--out``, ``--quick`` and ``--timeout``.

    Parameters
    ----------
    description : str
        The demo's docstring; its first line is shown.
    name : str
        Name of the demo: its results go to demos/output/<name>.
    timeout : float
        Default number of seconds for one job.
    docs : str, optional
        Help text of the option ``--docs``, which updates pictures; None leaves the option out.
    """
    found = argparse.ArgumentParser(description=description.splitlines()[0])
    found.add_argument(
        "--out",
        type=Path,
        default=HERE / "output" / name,
        metavar="DIR",
        help="folder for the results (default: %(default)s)",
    )
    found.add_argument("--quick", action="store_true", help="fewer points, a few seconds a job")
    found.add_argument(
        "--timeout",
        type=float,
        default=timeout,
        metavar="S",
        help="seconds for one step of a job (default: %(default)g)",
    )
    if docs is not None:
        found.add_argument("--docs", action="store_true", help=f"renew {docs}")
    return found


def work(jobs: Mapping[str, Job], output: Path, finish: Job | None = None) -> int:
    """Do all jobs in order; if one fails, the others are still done.

    Parameters
    ----------
    jobs : mapping of str to callable
        Titles and jobs.
    output : Path
        Folder of the results; it is created if missing.
    finish : callable, optional
        Called at the end, also after Ctrl-C, to use the results so far.

    Returns
    -------
    int
        0 if every job succeeded, 1 if one failed, 130 after Ctrl-C.
    """
    output.mkdir(parents=True, exist_ok=True)
    failed = []
    try:
        for number, (title, job) in enumerate(jobs.items(), start=1):
            print(f"[{number}/{len(jobs)}] {title}", flush=True)
            if not _done(job):
                failed.append(title)
    except KeyboardInterrupt:
        if finish is not None:
            _done(finish)
        print(f"\ninterrupted; what was finished is in {output}", file=sys.stderr)
        return 130
    if finish is not None and not _done(finish):
        failed.append("the summary")
    if failed:
        print(f"failed: {len(failed)} of {len(jobs)}: {', '.join(failed)}")
    print(f"results are in {output}")
    return 1 if failed else 0


@contextlib.contextmanager
def step(text: str) -> Iterator[None]:
    """Print what a job is doing, on a terminal with a running clock, and how long it took."""
    started, ended = time.perf_counter(), threading.Event()
    print(f"  {text} ...", flush=True)

    def tick() -> None:
        while not ended.wait(1.0):
            print(f"\r  {time.perf_counter() - started:.0f} s", end="", flush=True)

    clock = threading.Thread(target=tick, daemon=True)
    if sys.stdout.isatty():
        clock.start()
    try:
        yield
    finally:
        ended.set()
        if clock.ident is not None:
            clock.join()
            print("\r", end="")
        print(f"  {text}: {time.perf_counter() - started:.1f} s", flush=True)


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]], columns: Iterable[str] = ()) -> None:
    """Write the current rows; without `columns`, the first row determines the columns."""
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(columns) or list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def _done(job: Job) -> bool:
    try:
        job()
    except Exception as error:  # a failing input must not end the demo
        print(f"  failed: {error}", flush=True)
        return False
    return True
