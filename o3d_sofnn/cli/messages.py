"""Messages to the user: one line each, with the file names that the user gave."""

from __future__ import annotations

import argparse
import logging
import sys
from dataclasses import dataclass, field
from pathlib import Path

from o3d_sofnn.cli.parser import BAD_INPUT
from o3d_sofnn.progress import printable

FAILURE = 1


@dataclass
class Messages:
    """The messages of a call.

    Attributes
    ----------
    names : dict of str to str
        Names for files that the user did not name: "standard input" for its temporary file.
    about : str
        The file being processed, if there are several: warnings about it begin with its name.
    """

    names: dict[str, str] = field(default_factory=dict)
    about: str = ""

    def named(self, text: str) -> str:
        """Return ``text`` on one line, with the file names that the user knows."""
        for path, name in self.names.items():
            text = text.replace(path, name)
        return printable(text)

    def complain(self, code: int, text: str) -> int:
        """Write one line and return ``code``."""
        sys.stderr.write(f"o3d-sofnn: error: {self.named(text)}\n")
        return code

    def formatter(self) -> logging.Formatter:
        """Return a formatter that makes one line of a log record."""
        return _OneLine(self)


class _OneLine(logging.Formatter):
    """One line per record."""

    def __init__(self, messages: Messages) -> None:
        super().__init__("o3d-sofnn: %(levelname)s: %(message)s")
        self._messages = messages

    def formatMessage(self, record: logging.LogRecord) -> str:
        """Add the name of the file to a record if there are several."""
        about = self._messages.about
        if about and about not in record.message:
            record.message = f"{about}: {record.message}"
        return super().formatMessage(record)

    def format(self, record: logging.LogRecord) -> str:
        return self._messages.named(super().format(record))


def told(error: Exception, args: argparse.Namespace, source: str | Path) -> tuple[int, str]:
    """Return the exit code and the message of a failure; raise it if it is a bug of this program.

    Parameters
    ----------
    error : Exception
        The failure.
    args : argparse.Namespace
        The parsed arguments.
    source : str or pathlib.Path
        The file of the points.
    """
    match error:
        case ValueError():
            return BAD_INPUT, _as_typed(str(error), args, source)
        case MemoryError():
            return FAILURE, f"not enough memory{f': {error}' if str(error) else ''}"
        case OSError(filename=None, strerror=None):
            return FAILURE, str(error)
        case OSError(filename=None):
            return FAILURE, str(error.strerror)
        case OSError():
            return FAILURE, f"{error.filename}: {error.strerror}"
        case ImportError() | RuntimeError():
            return FAILURE, str(error)
    raise error


def _as_typed(message: str, args: argparse.Namespace, source: str | Path) -> str:
    """Replace names in a message by what was typed: the shell option, or the file of the points."""
    name, _, rest = message.partition(": ")
    if name == "pcd":
        return f"{source}: {rest}"
    if message.startswith("points "):
        return f"{source}: {message}"
    option = name.removeprefix("n_")
    return f"--{option.replace('_', '-')}: {rest}" if option in vars(args) else message
