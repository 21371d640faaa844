"""Progress reports: a bar, or plain lines that another program can read."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol, TextIO

ProgressCallback = Callable[[float, str], None]
"""Called with the fraction done (0 to 1) and the current stage; exceptions propagate."""


ProgressMode = Literal["auto", "bar", "plain", "none"]


class Progress(Protocol):
    """A progress callback with an end."""

    def __call__(self, fraction: float, text: str) -> None:
        """Report ``fraction`` (0 to 1) done and the stage ``text`` that runs now."""

    def close(self) -> None:
        """Clean up the terminal; safe to call twice."""


class ProgressBar:
    """One line on a terminal, redrawn in place.

    Parameters
    ----------
    stream : text stream, optional
        Where to draw; None is the current standard error stream.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        # Without a console there is no standard error stream, and nothing is drawn.
        self._stream: TextIO | None = sys.stderr if stream is None else stream
        self._shown: tuple[int, str] | None = None

    def __call__(self, fraction: float, text: str) -> None:
        """Redraw the line when the percentage or the text has changed."""
        state = (_percent(fraction), text)
        if state == self._shown:
            return
        self._shown = state
        columns = shutil.get_terminal_size().columns
        width = max(10, min(40, columns - 40))
        filled = width * state[0] // 100
        line = f"[{'#' * filled}{'.' * (width - filled)}] {state[0]:3d} % {printable(text)}"
        # Erase to the end of the line, so that a shorter text leaves nothing of a longer one.
        self._write(f"\r{line[: columns - 1]}\x1b[K")

    def close(self) -> None:
        """End the line."""
        if self._shown is not None:
            self._write("\n")
            self._shown = None

    def _write(self, text: str) -> None:
        if self._stream is None:
            return
        try:
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):  # a terminal that is gone, or a stream that is closed
            self._stream = None  # the work goes on without a bar


class TimedBar:
    """A bar of tqdm: it says the time left, and is a widget in notebooks.

    Parameters
    ----------
    tqdm : type
        The class ``tqdm.auto.tqdm``.
    """

    def __init__(self, tqdm: Any) -> None:
        self._tqdm = tqdm
        self._bar: Any = None
        self._shown: tuple[int, str] | None = None
        self._lost = False

    def __call__(self, fraction: float, text: str) -> None:
        """Redraw the bar when the percentage or the text has changed."""
        state = (_percent(fraction), printable(text))
        if state == self._shown or self._lost:
            return
        self._shown = state
        try:
            if self._bar is None:
                form = "{l_bar}{bar}| {elapsed}<{remaining}"
                self._bar = self._tqdm(total=100, bar_format=form, dynamic_ncols=True)
            self._bar.n = state[0]
            self._bar.set_description(state[1])
        except (OSError, ValueError):  # a terminal that is gone, or a stream that is closed
            self._lose()

    def close(self) -> None:
        """End the bar; what is reported later begins another."""
        if self._bar is not None:
            try:
                self._bar.close()
            except (OSError, ValueError):
                self._lose()
        self._bar = self._shown = None

    def _lose(self) -> None:
        self._lost = True  # the work is worth more than its bar
        if self._bar is not None:
            self._bar.disable = True  # or it would write once more when it is deleted


class PlainProgress:
    """Lines ``PROGRESS n text`` with the percentage n, an integer that never decreases.

    Parameters
    ----------
    stream : text stream, optional
        Where to write; None is the current standard output stream.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stdout if stream is None else stream
        self._shown: tuple[int, str] = (0, "")

    def __call__(self, fraction: float, text: str) -> None:
        """Write one line when the percentage or the text has changed."""
        state = (max(_percent(fraction), self._shown[0]), printable(text))
        if state != self._shown:
            self._shown = state
            self._stream.write(f"PROGRESS {state[0]} {state[1]}\n")
            self._stream.flush()

    def close(self) -> None:
        """Nothing to tidy: every line is complete."""


class NoProgress:
    """Reports nothing."""

    def __call__(self, fraction: float, text: str) -> None:
        """Ignore the report."""

    def close(self) -> None:
        """Nothing to tidy."""


def make_bar() -> Progress:
    """Return a bar for the standard error stream of the moment: of tqdm where that is installed."""
    if sys.stderr is None:
        return NoProgress()
    try:
        from tqdm.auto import tqdm
    except ImportError:
        return ProgressBar()
    return TimedBar(tqdm)


def make_progress(mode: ProgressMode) -> Progress:
    """Return the reporter for a command line's ``--progress``.

    Parameters
    ----------
    mode : {"auto", "bar", "plain", "none"}
        "auto" is a bar when the standard error stream is a terminal, else nothing.

    Returns
    -------
    Progress
        The reporter, to be closed by the caller.
    """
    if mode == "plain":
        return PlainProgress()
    if mode == "bar" or (mode == "auto" and sys.stderr is not None and sys.stderr.isatty()):
        return make_bar()
    return NoProgress()


def rescale(progress: ProgressCallback, start: float, stop: float) -> ProgressCallback:
    """Return a callback that maps 0 to 1 onto ``start`` to ``stop`` of ``progress``."""

    def report(fraction: float, text: str) -> None:
        progress(start + (stop - start) * fraction, text)

    return report


def printable(text: str) -> str:
    """Return ``text`` on one line, with escapes for control and unprintable characters.

    File names may contain control characters, and bytes that are not text.
    """
    return "".join(
        letter if letter.isprintable() else letter.encode("unicode_escape").decode("ascii")
        for letter in " ".join(text.split())
    )


def _percent(fraction: float) -> int:
    return int(100 * min(max(fraction, 0.0), 1.0))


STAGES = {
    "cells": 0.02,
    "scale": 0.08,
    "orientation": 0.35,
    "typical data": 0.37,
    "rules": 0.42,
    "outliers": 0.43,
    "growth": 0.45,
    "inference": 0.50,
    "local surfaces": 0.55,
    "field": 0.60,
    "surface": 0.95,
    "attributes": 1.00,
}
"""Stages in order, and the fraction of the work that is done after each."""


@dataclass
class Clock:
    """Measures the seconds per stage, and reports stages to a callback."""

    progress: ProgressCallback | None
    seconds: dict[str, float] = field(default_factory=dict)
    _done: float = 0.0

    def stage(self, name: str) -> _Stage:
        """Announce a stage, and add the time of the block to it; a stage may occur again."""
        return _Stage(self, name)

    def finish(self) -> None:
        """Announce the end."""
        if self.progress:
            self.progress(1.0, "done")


@dataclass
class _Stage:
    # Not a generator: there, the StopIteration of a callback would become a RuntimeError.
    clock: Clock
    name: str
    start: float = 0.0

    def __enter__(self) -> None:
        before = [0.0, *STAGES.values()][list(STAGES).index(self.name)]
        self.clock._done = max(self.clock._done, before)
        if self.clock.progress:
            self.clock.progress(self.clock._done, self.name)
        self.start = time.perf_counter()

    def __exit__(self, failed: type[BaseException] | None, *_: object) -> None:
        if failed is None:
            taken = time.perf_counter() - self.start
            self.clock.seconds[self.name] = self.clock.seconds.get(self.name, 0.0) + taken
