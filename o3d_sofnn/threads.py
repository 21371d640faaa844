"""How many threads the call in progress may start: said once, where it enters, and read at kernels.

A context variable rather than an argument of every function on the way: each thread of the user's
program has its own, so that two calls at the same time do not share it. No result depends on it.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

__all__ = ["thread_count", "using_threads"]

ALL = -1
_MOST = 256
"""More threads than any machine has cores gain nothing, and the system may refuse them."""

_allowed: ContextVar[int] = ContextVar("n_threads", default=ALL)


@contextmanager
def using_threads(n_threads: int) -> Iterator[None]:
    """Limit what runs inside the ``with`` block to a number of threads.

    Parameters
    ----------
    n_threads : int
        -1 (one per core) or at least 1.
    """
    token = _allowed.set(n_threads)
    try:
        yield
    finally:
        _allowed.reset(token)


def thread_count() -> int:
    """Return how many threads a kernel may start here: one per core, or as many as were allowed."""
    allowed = _allowed.get()
    if allowed > 0:
        return min(allowed, _MOST)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
