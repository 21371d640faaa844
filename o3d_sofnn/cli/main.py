"""The command line ``o3d-sofnn normals|reconstruct IN OUT`` and ``compare IN... --out DIR``."""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import signal
import sys
from collections.abc import Sequence

from o3d_sofnn.cli import commands, comparison, streams
from o3d_sofnn.cli.parser import BAD_INPUT, make_parser
from o3d_sofnn.cli.signals import Signals
from o3d_sofnn.progress import make_progress, printable

FAILURE = 1


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
        The exit code: 0 done, 2 bad input or options, 1 other failures, 128 and its number after
        a signal (130 after Ctrl-C).
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
    handler = logging.StreamHandler()
    handler.setFormatter(_OneLine("o3d-sofnn: %(levelname)s: %(message)s"))
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
            report = commands.run(args, progress)
        commands.write_report(report, args.json)
    except Exception as error:
        if signals.heard is not None:
            raise
        return _failed(error, args)
    return 0


def _check_working_directory() -> None:
    try:
        os.getcwd()
    except OSError as error:  # Open3D's libraries would end the process without a word of why
        raise OSError(error.errno, "not there any more", "the working directory") from None


def _interrupted(number: int) -> int:
    # If code that was a text (as data classes make it) was interrupted, Python would kill itself by
    # SIGINT in place of the exit code, unless other such code has run since.
    exec("")
    return _complain(SIGNALLED + number, "interrupted")


def _failed(error: Exception, args: argparse.Namespace) -> int:
    """Say in one line what went wrong, unless it is a fault of this program."""
    match error:
        case ValueError():
            return _complain(BAD_INPUT, _as_typed(str(error), args))
        case MemoryError():
            return _complain(FAILURE, f"not enough memory{f': {error}' if str(error) else ''}")
        case OSError(filename=None, strerror=None):
            return _complain(FAILURE, str(error))
        case OSError(filename=None):
            return _complain(FAILURE, str(error.strerror))
        case OSError():
            return _complain(FAILURE, f"{error.filename}: {error.strerror}")
        case ImportError() | RuntimeError():
            return _complain(FAILURE, str(error))
    raise error


def _as_typed(message: str, args: argparse.Namespace) -> str:
    """Let a message name what was typed: an option of the shell, or the file of the points."""
    name, _, rest = message.partition(": ")
    if name == "pcd":
        return f"{args.input}: {rest}"
    if message.startswith("points "):
        return f"{args.input}: {message}"
    option = name.removeprefix("n_")
    return f"--{option.replace('_', '-')}: {rest}" if option in vars(args) else message


def _complain(code: int, message: str) -> int:
    """Write one line and return ``code``."""
    sys.stderr.write(f"o3d-sofnn: error: {printable(message)}\n")
    return code


class _OneLine(logging.Formatter):
    """One line a record."""

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))
