"""Standard streams of a command that may be closed, full, broken, or of a limited encoding."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TextIO, cast


class _Stream:
    """A standard stream, or a replacement for a closed one.

    Parameters
    ----------
    stream : text stream or None
        Python's stream; None for a descriptor that was closed at the start.
    name : str
        Name for messages.
    wanted : bool
        Whether the text is a result: then it is an error if it cannot be written. Other text is
        dropped silently.
    """

    def __init__(self, stream: TextIO | None, name: str, wanted: bool) -> None:
        self._stream = stream
        self._name = name
        self._wanted = wanted

    def write(self, text: str) -> int:
        """Write ``text``; characters that the stream's encoding lacks are escaped."""
        with self._trouble_named():
            if self._stream is None:
                raise OSError(errno.EBADF, "closed")
            encoding = self._stream.encoding or "utf-8"
            self._stream.write(text.encode(encoding, "backslashreplace").decode(encoding))
        return len(text)

    def write_file(self, path: Path) -> None:
        """Write the bytes of a file."""
        with self._trouble_named(), path.open("rb") as source:
            if self._stream is None:
                raise OSError(errno.EBADF, "closed")
            self._stream.flush()
            shutil.copyfileobj(source, self._stream.buffer)
            self._stream.buffer.flush()

    def flush(self) -> None:
        """Flush the stream."""
        with self._trouble_named():
            if self._stream is not None:
                self._stream.flush()

    def isatty(self) -> bool:
        """Return whether the stream is a terminal."""
        return self._stream is not None and not self._stream.closed and self._stream.isatty()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    @contextlib.contextmanager
    def _trouble_named(self) -> Iterator[None]:
        try:
            yield
        except (OSError, ValueError) as error:  # a stream that Python has closed: ValueError
            if self._stream is not None:
                _drain(self._stream)
                self._stream = None
            if self._wanted:
                code = getattr(error, "errno", None) or errno.EBADF
                reason = getattr(error, "strerror", None) or "closed"
                raise OSError(code, reason, self._name) from error


def _drain(stream: TextIO) -> None:
    """Discard what is left in a stream: Python would try again at exit, and complain."""
    with contextlib.suppress(OSError, ValueError), open(os.devnull, "w") as sink:
        os.dup2(sink.fileno(), stream.fileno())


def write_file(path: Path) -> None:
    """Write the bytes of a file to the standard output stream, within the block of ``guarded``."""
    cast(_Stream, sys.stdout).write_file(path)


def read_file(path: Path) -> None:
    """Copy the standard input stream to a file.

    Raises
    ------
    OSError
        The stream is closed or broken, or the disk is full.
    """
    if sys.stdin is None:
        raise OSError(errno.EBADF, "closed", "standard input")
    with path.open("xb") as target:
        shutil.copyfileobj(sys.stdin.buffer, target)


@contextlib.contextmanager
def guarded() -> Iterator[None]:
    """Make ``sys.stdout`` and ``sys.stderr`` safe to write to within the block.

    A closed descriptor (``2>&-``) is opened on the null device: otherwise the next opened file
    would become the standard error stream and receive what native libraries print.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the lowest free number: this one
    before = sys.stdout, sys.stderr
    sys.stdout = cast(TextIO, _Stream(sys.stdout, "standard output", wanted=True))
    sys.stderr = cast(TextIO, _Stream(sys.stderr, "standard error", wanted=False))
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before
