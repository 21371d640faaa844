"""Processing of all files of a call, one after the other; a failure does not stop the others."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import Any

from o3d_sofnn.cli import commands, jobs, messages
from o3d_sofnn.progress import Progress, ProgressCallback, rescale


def run(
    args: argparse.Namespace,
    progress: Progress,
    said: messages.Messages,
    check: Callable[[], None],
) -> int:
    """Carry out a command, and write the report.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments from the parser of :mod:`o3d_sofnn.cli.main`.
    progress : Progress
        Called with the fraction done and the current stage.
    said : Messages
        Reports what went wrong.
    check : callable
        Raises KeyboardInterrupt if a signal was received.

    Returns
    -------
    int
        The exit code: the highest of those of the files.

    Raises
    ------
    ValueError
        Arguments do not fit together.
    OSError
        Outputs or the report cannot be written.
    """
    from o3d_sofnn.files import outputs, point_files

    is_mesh = args.command == "reconstruct"
    endings = point_files.MESH_OUTPUTS if is_mesh else point_files.CLOUD_OUTPUTS
    reports: list[dict[str, Any]] = []
    codes = [0]
    with jobs.planned(args, said) as plan:
        for job in plan.jobs:
            outputs.check_output(job.target, endings)
        if jobs.STREAM in (args.json, args.output):
            sys.stdout.write("")  # raises here if the stream is closed
        if args.json not in (None, jobs.STREAM):
            outputs.check_output(args.json, ())
        for number, job in enumerate(plan.jobs):
            part: ProgressCallback = progress
            if plan.several:
                said.about = str(job.source)
                part = _part(progress, number, len(plan.jobs), job.source.name)
            try:
                reports.append(commands.run(args, job, part))
            except Exception as error:
                check()
                code, text = messages.told(error, args, job.source)
                progress.close()
                codes.append(said.complain(code, text))
                files = {"command": args.command, **job.report}
                reports.append({**files, "error": said.named(text)})
    progress.close()
    failed = len(codes) - 1
    if not plan.several:
        if not failed:
            commands.write_report(reports[0], args.json)
        return max(codes)
    commands.write_report(reports, args.json)
    if failed:
        said.complain(max(codes), f"{failed} of {len(reports)} files failed")
    return max(codes)


def _part(progress: Progress, number: int, count: int, name: str) -> ProgressCallback:
    """Return a callback for the progress of one file, as a part of the whole, with its name."""
    part = rescale(progress, number / count, (number + 1) / count)
    return lambda fraction, text: part(fraction, f"{name}: {text}")
