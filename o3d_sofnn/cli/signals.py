"""Signals: the first one ends the work cleanly, whatever is being done."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

from o3d_sofnn.progress import Progress


class Signals:
    """Turn Ctrl-C, SIGTERM and SIGHUP into KeyboardInterrupt while they are handled.

    Only the first one is raised, so that it does not disturb the cleanup. Signals that are ignored
    (``nohup``, a background job) or handled by others are left alone.

    Parameters
    ----------
    last : bool
        Whether the process ends after the command: then a second signal that arrives while the
        interpreter shuts down has no effect.

    Attributes
    ----------
    heard : int or None
        Number of the first signal. Libraries may convert or swallow an exception that is raised
        during their import; this attribute still records the signal.
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
        """Restore the earlier handling of signals."""
        over = self._last and self.heard is not None
        for number, handler in self._before.items():
            # A handler in Python would be removed before the interpreter has ended.
            signal.signal(number, signal.SIG_IGN if over else handler)

    @contextlib.contextmanager
    def heeded(self) -> Iterator[None]:
        """Raise KeyboardInterrupt within the block if a signal arrives, or has arrived."""
        self._heeded = True
        try:
            self.check()
            yield
        finally:
            self._heeded = False

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Delay signals until the block has ended, for imports of native libraries."""
        self._heeded = False
        try:
            yield
        finally:
            self._heeded = True
        self.check()

    def check(self) -> None:
        """Raise KeyboardInterrupt if a signal was received, even if its exception was lost."""
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
