"""Stages of the method: how far each one is, and how long it took."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

Progress = Callable[[float, str], None]

STAGES = {
    "cells": 0.02,
    "scale": 0.08,
    "orientation": 0.35,
    "typical data": 0.37,
    "rules": 0.42,
    "growth": 0.45,
    "inference": 0.50,
    "local surfaces": 0.55,
    "field": 0.60,
    "surface": 0.95,
    "attributes": 1.00,
}
"""Stages in order, and the part of the whole that is done after each."""


@dataclass
class Clock:
    """Seconds per stage, and word to whoever wants to know."""

    progress: Progress | None
    seconds: dict[str, float] = field(default_factory=dict)
    _done: float = 0.0

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce a stage, and add the time of the block to it; a stage may come again."""
        before = [0.0, *STAGES.values()][list(STAGES).index(name)]
        self._done = max(self._done, before)
        if self.progress:
            self.progress(self._done, name)
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def finish(self) -> None:
        """Announce the end."""
        if self.progress:
            self.progress(1.0, "done")
