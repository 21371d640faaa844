"""Run one function in a separate process, which contains crashes, hangs and leaks."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import re
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any
from unittest import mock

_ENDING = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]


@dataclass(frozen=True)
class Outcome:
    """The outcome of a call.

    Attributes
    ----------
    value : object
        Return value of the function; None after a failure.
    error : str or None
        One line about the failure; None after success.
    seconds : float
        Wall time of the function only; after a failure, including the start of the process.
    peak_mb : float or None
        Largest resident memory of the process, in MB, including imports; None if the system does
        not provide it.
    """

    value: Any
    error: str | None
    seconds: float
    peak_mb: float | None

    def get(self) -> Any:
        """Return the value.

        Raises
        ------
        RuntimeError
            The call failed; the message says how.
        """
        if self.error is not None:
            raise RuntimeError(self.error)
        return self.value


def call(
    function: Callable[..., Any],
    *args: Any,
    timeout: float,
    environment: dict[str, str] | None = None,
) -> Outcome:
    """Call ``function(*args)`` in a new process and wait for it.

    Parameters
    ----------
    function : callable
        A function at the top level of a module. Its arguments and result must be picklable.
    *args : object
        Arguments of the function.
    timeout : float
        Seconds after which the process is killed.
    environment : dict of str to str, optional
        Environment variables of the new process in addition to those of this one.

    Returns
    -------
    Outcome
        The outcome; failures of the function do not raise.

    Raises
    ------
    KeyboardInterrupt
        After Ctrl-C, SIGTERM or SIGHUP; the process is killed.
    """
    # A new interpreter: threads and graphics contexts do not survive a fork.
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    with tempfile.TemporaryDirectory() as folder, _heeding_termination():
        log = Path(folder, "log")
        process = context.Process(target=_child, args=(sender, log, function, args), daemon=True)
        started = time.perf_counter()
        try:
            with _deaf_to_signals(), mock.patch.dict(os.environ, environment or {}):
                process.start()
            sender.close()
            if receiver.poll(timeout):
                return Outcome(*receiver.recv())
            message = f"stopped after {timeout:.0f} s"
        except EOFError:
            process.join()
            message = _death(process.exitcode) + _last_line(log)
        finally:
            if process.pid is not None:
                process.kill()
                process.join()
            receiver.close()
    return Outcome(None, message, time.perf_counter() - started, None)


@contextlib.contextmanager
def _heeding_termination() -> Iterator[None]:
    """Treat these signals like Ctrl-C: by default they would end this process but not the other."""

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    # Handlers that others have installed are left alone.
    taken = [number for number in _ENDING if signal.getsignal(number) is signal.SIG_DFL]
    for number in taken:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


@contextlib.contextmanager
def _deaf_to_signals() -> Iterator[None]:
    """Start a process that never receives Ctrl-C, which is sent to the whole process group.

    A new process inherits the blocked signals. In this process, signals must wait until the start
    is over, whichever thread gets them: an interrupted start would leave an orphan process.
    """
    heard: list[int] = []
    handlers = {
        number: signal.signal(number, lambda number, frame: heard.append(number))
        for number in (signal.SIGINT, *_ENDING)
        if signal.getsignal(number) is not None  # set in C: it could not be put back
    }
    blocked = hasattr(signal, "pthread_sigmask")
    if blocked:
        # Python's own helper process would unblock the signal when it starts.
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        if blocked:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        for number, handler in handlers.items():
            signal.signal(number, handler)
    for number in heard:
        signal.raise_signal(number)


def _child(
    sender: Connection, log: Path, function: Callable[..., Any], args: tuple[Any, ...]
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # for Windows, where nothing can be blocked
    with log.open("w") as stream:
        # Libraries written in C++ print past Python's streams.
        os.dup2(stream.fileno(), 1)
        os.dup2(stream.fileno(), 2)
    started = time.perf_counter()
    value, error = None, None
    try:
        value = function(*args)
    except MemoryError:
        error = "not enough memory"
    except Exception as failure:  # any exception belongs in the report
        text = str(failure).strip().splitlines() or [""]
        error = f"{type(failure).__name__}: {text[0]}"[:300]
    sender.send((value, error, time.perf_counter() - started, peak_mb()))


def peak_mb() -> float | None:
    """Return the largest resident memory of this process so far, in MB; None if unknown."""
    status = Path("/proc/self/status")
    if status.exists():  # getrusage would count what the parent had before it started this process
        found = re.search(r"VmHWM:\s+(\d+) kB", status.read_text())
        return int(found[1]) / 1024.0 if found else None
    if sys.platform == "darwin":
        import resource

        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2.0**20
    return None


def _death(code: int | None) -> str:
    if code is not None and code < 0:
        return f"crashed ({signal.Signals(-code).name})"
    return f"ended with exit code {code}"


def _last_line(log: Path) -> str:
    lines = log.read_text(errors="replace").strip().splitlines() if log.exists() else []
    return f": {lines[-1][:200]}" if lines else ""
