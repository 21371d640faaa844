"""The command line ``o3d-sofnn normals|reconstruct IN... OUT`` and ``compare IN... --out DIR``."""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import signal
from collections.abc import Sequence

from o3d_sofnn.cli import batch, commands, comparison, streams
from o3d_sofnn.cli.messages import FAILURE as FAILURE
from o3d_sofnn.cli.messages import Messages, told
from o3d_sofnn.cli.parser import BAD_INPUT as BAD_INPUT
from o3d_sofnn.cli.parser import make_parser
from o3d_sofnn.cli.signals import Signals
from o3d_sofnn.online import command as online
from o3d_sofnn.progress import make_progress
from o3d_sofnn.tiles import command as tiles

# What a shell reports for a program that a signal ended is this, and the number of the signal.
SIGNALLED = 128


INTERRUPTED = SIGNALLED + signal.SIGINT


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        The exit code: 0 done, 2 bad input (also of one of several files) or options, 1 other
        failures, 128 and its number after a signal (130 after Ctrl-C).
    """
    with streams.guarded(), contextlib.closing(Signals(last=argv is None)) as signals:
        try:
            with signals.heeded():
                return _run(make_parser().parse_args(argv), signals)
        except Exception:
            # Whatever a library has made of the exception, or did in its wake.
            if signals.heard is None:
                raise
            return _interrupted(signals.heard)
        except KeyboardInterrupt:
            return _interrupted(signals.heard or signal.SIGINT)


def _run(args: argparse.Namespace, signals: Signals) -> int:
    said = Messages()
    handler = logging.StreamHandler()
    handler.setFormatter(said.formatter())
    logging.basicConfig(handlers=[handler], force=True)
    logging.getLogger("laspy").setLevel(logging.CRITICAL)  # one line on errors: ours
    try:
        _check_working_directory()
        with contextlib.closing(signals.watched(make_progress(args.progress))) as progress:
            progress(0.0, "load")
            with signals.waiting():
                commands.load(args.command)
            if args.command == "compare":
                return comparison.run(args, progress)
            if args.command == "tiles":
                return tiles.run(args, progress)
            if args.command == "watch":
                return online.watch(args, progress)
            if online.are_sweeps(args):
                return online.reconstruct(args, progress)
            return batch.run(args, progress, said, signals.check)
    except Exception as error:
        if signals.heard is not None:
            raise
        # Where inputs are told apart, their failures are told by the batch.
        return said.complain(*told(error, args, "IN"))


def _check_working_directory() -> None:
    try:
        os.getcwd()
    except OSError as error:  # Open3D's libraries would end the process without a word of why
        raise OSError(error.errno, "not there any more", "the working directory") from None


def _interrupted(number: int) -> int:
    # If code that was a text (as data classes make it) was interrupted, Python would kill itself by
    # SIGINT in place of the exit code, unless other such code has run since.
    exec("")
    return Messages().complain(SIGNALLED + number, "interrupted")
