"""A separate process for native readers, which may crash or allocate any amount of memory.

Their results come back through a pipe, in frames: eight bytes with the length, then the bytes.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

_END = -2


_FAILED = -1


_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]);"
    "from o3d_sofnn.files import child; child.main(*sys.argv[2:])"
)


# Seconds for starting and for reading: several times what a busy machine needs.
_SECONDS, _SECONDS_PER_MEGABYTE = 60.0, 4.0


# Address space: an interpreter with NumPy or Open3D, the stacks and heaps of one thread per core,
# and several copies of the file.
_MEMORY, _MEMORY_PER_CORE, _COPIES = 2**30, 2**28, 16


def run(module: str, path: Path) -> Iterator[bytearray]:
    """Yield what ``module.frames(path)`` yields in a new process.

    Parameters
    ----------
    module : str
        Name of a module whose ``frames`` takes a path as text and yields bytes.
    path : pathlib.Path
        The file; its size also determines how much time and memory the reader gets.

    Yields
    ------
    bytearray
        One per frame.

    Raises
    ------
    ValueError
        The process failed, crashed, or took too long; the message names the file.
    ImportError
        A package is missing; the message says what to type.
    """
    size = path.stat().st_size
    memory = _MEMORY + _MEMORY_PER_CORE * (os.cpu_count() or 1) + _COPIES * size
    command = [sys.executable, "-c", _START, json.dumps(sys.path), module, str(path), str(memory)]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as process:
        assert process.stdout is not None
        timer = threading.Timer(_SECONDS + _SECONDS_PER_MEGABYTE * size / 2**20, process.kill)
        timer.start()
        try:
            yield from _received(process.stdout, path)
        finally:
            timer.cancel()
            process.kill()


def main(module: str, path: str, memory: str) -> None:
    """Send the frames of ``module.frames(path)`` to the standard output stream.

    This runs in the process that may crash. It is called by the parent process, not by users.
    """
    # Native code may print: its streams lead nowhere, the pipe is ours.
    with os.fdopen(os.dup(1), "wb") as pipe:
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, 1)
        os.dup2(sink, 2)
        _limit(int(memory))
        try:
            for frame in importlib.import_module(module).frames(path):
                _send(pipe, len(frame), frame)
            _send(pipe, _END, b"")
        except BrokenPipeError:
            pass
        except BaseException as error:  # a panic in Rust is not an Exception
            text = f"{type(error).__name__}: {' '.join(str(error).split())}"
            _send(pipe, _FAILED, text.encode())


def _received(stream: IO[bytes], path: Path) -> Iterator[bytearray]:
    while True:
        head = stream.read(8)
        length = int.from_bytes(head, "little", signed=True)
        if len(head) < 8:
            raise ValueError(f"{path}: not readable: its reader crashed, or took too long")
        if length == _END:
            return
        if length == _FAILED:
            raise _error(stream.read().decode(errors="replace"), path)
        frame = bytearray(length)
        if stream.readinto(frame) < length:  # type: ignore[attr-defined]
            raise ValueError(f"{path}: not readable: its reader crashed")
        yield frame


def _error(text: str, path: Path) -> Exception:
    kind, _, message = text.partition(": ")
    if kind == "ImportError":
        return ImportError(message)
    # libE57 appends the location in its sources.
    message = message.partition("****")[0].strip() or kind
    return ValueError(f"{path}: not readable: {message[:200]}")


def _send(pipe: IO[bytes], length: int, frame: Any) -> None:
    pipe.write(length.to_bytes(8, "little", signed=True))
    pipe.write(frame)
    pipe.flush()


def _limit(memory: int) -> None:
    """Limit the address space of this process, if the system supports it."""
    if sys.platform == "win32":
        return
    import resource

    for kind, wanted in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CORE, 0)):
        hard = resource.getrlimit(kind)[1]
        bound = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        with contextlib.suppress(OSError, ValueError):  # macOS may refuse
            resource.setrlimit(kind, (bound, hard))
