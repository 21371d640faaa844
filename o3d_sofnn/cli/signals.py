"""Signals: the first one ends the work in good order, wherever it meets it."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

from o3d_sofnn.progress import Progress


class Signals:
    """Take Ctrl-C, SIGTERM and SIGHUP for KeyboardInterrupt while they are heeded.

    Only the first one is raised: what tidies up after it is left in peace. Signals that are
    ignored (``nohup``, a job in the background) or that somebody else handles stay as they are.

    Parameters
    ----------
    last : bool
        Whether nothing comes after the command in this process: then a signal that comes while
        the interpreter ends, after another one, changes nothing any more.

    Attributes
    ----------
    heard : int or None
        Number of the first signal. Libraries turn an exception in the midst of their import into
        one of another kind, or swallow it: this tells what it was.
    """

    def __init__(self, last: bool) -> None:
        self.heard: int | None = None
        self._last = last
        self._heeded = False
        self._before: dict[int, Any] = {}
        if threading.current_thread() is threading.main_thread():
            for name in ("SIGINT", "SIGTERM", "SIGHUP"):
                number = getattr(signal, name, None)
                usual = (signal.SIG_DFL, signal.default_int_handler)
                if number is not None and signal.getsignal(number) in usual:
                    self._before[number] = signal.signal(number, self._hear)

    def close(self) -> None:
        """Handle signals as before."""
        over = self._last and self.heard is not None
        for number, handler in self._before.items():
            # A handler in Python would be taken away before the interpreter has ended.
            signal.signal(number, signal.SIG_IGN if over else handler)

    @contextlib.contextmanager
    def heeded(self) -> Iterator[None]:
        """Raise KeyboardInterrupt within the block when a signal comes, or has come."""
        self._heeded = True
        try:
            self.check()
            yield
        finally:
            self._heeded = False

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Let signals wait until the block has ended: for the import of native libraries."""
        self._heeded = False
        try:
            yield
        finally:
            self._heeded = True
        self.check()

    def check(self) -> None:
        """Raise for a signal that was heard, also when its exception went astray."""
        if self.heard is not None:
            raise KeyboardInterrupt

    def watched(self, progress: Progress) -> Progress:
        """Return ``progress`` with a check at every report."""
        return _Watched(self, progress)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        first = self.heard is None
        self.heard = self.heard or number
        if first and self._heeded:
            raise KeyboardInterrupt


class _Watched:
    def __init__(self, signals: Signals, progress: Progress) -> None:
        self._signals = signals
        self._progress = progress

    def __call__(self, fraction: float, text: str) -> None:
        self._signals.check()
        self._progress(fraction, text)

    def close(self) -> None:
        self._progress.close()
