"""Regular files only: nothing that blocks, and nothing read that the file has no room for."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

# Contents may be so many times the bytes they are packed in, however few those are: more than any
# measured points, and what zip, LAZ and instances of glTF reach only with copies of the same.
_MOST_EXPANSION, _ALWAYS_ALLOWED = 100, 2**27


class NotRegularError(ValueError):
    """What should be a file is a device, a pipe or a socket."""


def too_large(size: int, packed: int) -> bool:
    """Return whether ``size`` bytes cannot be honest contents of ``packed`` ones."""
    return size > max(_MOST_EXPANSION * packed, _ALWAYS_ALLOWED)


def open_regular(path: Path) -> BinaryIO:
    """Open a regular file for reading; links are followed.

    Raises
    ------
    OSError
        The file does not exist, is a folder, or may not be read.
    NotRegularError
        The path is a device, a pipe or a socket: reading it might never end.
    """
    # Without O_NONBLOCK, opening a pipe already waits for somebody who writes into it.
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    descriptor = os.open(path, flags)
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(mode):
            raise NotRegularError(f"{path}: expected a regular file, got a device or pipe")
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def bytes_left(stream: BinaryIO) -> int:
    """Return the number of bytes between the stream's position and the end of its file."""
    return max(os.fstat(stream.fileno()).st_size - stream.tell(), 0)


def read_records(stream: BinaryIO, path: Path, count: int, size: int) -> bytes:
    """Return ``count`` records of ``size`` bytes, looked for in the file before memory is taken.

    Raises
    ------
    ValueError
        The file is too short for them.
    """
    data = stream.read(count * size) if count * size <= bytes_left(stream) else b""
    if len(data) < count * size:
        room = bytes_left(stream) // size
        raise ValueError(
            f"{path}: cut short: its header says {count} points, it has room for {room}"
        )
    return data
