"""What all demos share: options, one line of progress a job, failures that stay where they are."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

HERE = Path(__file__).parent

Job = Callable[[], None]
"""Does a part of a demo and prints what came out; raises what went wrong."""


def parser(description: str, name: str, timeout: float) -> argparse.ArgumentParser:
    """Return a parser with the options ``--out``, ``--quick`` and ``--timeout``.

    Parameters
    ----------
    description : str
        The demo's docstring; its first line is shown.
    name : str
        Of the demo: its results go to demos/output/<name>.
    timeout : float
        Default number of seconds for one job.
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
    return found


def work(jobs: Mapping[str, Job], output: Path, finish: Job | None = None) -> int:
    """Do all jobs in order; whatever fails, the others go on.

    Parameters
    ----------
    jobs : mapping of str to callable
        Titles and jobs.
    output : Path
        Where the results are; made when it is missing.
    finish : callable, optional
        Done at the end, also after Ctrl-C, with what there is.

    Returns
    -------
    int
        0 when every job succeeded, 1 when one failed, 130 after Ctrl-C.
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


def _done(job: Job) -> bool:
    try:
        job()
    except Exception as error:  # one input must not end the demo
        print(f"  failed: {error}", flush=True)
        return False
    return True
