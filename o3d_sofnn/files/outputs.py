"""Output files: they are checked before the work, and written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import secrets
import stat
from collections.abc import Collection, Iterable, Iterator
from pathlib import Path
from typing import BinaryIO


def check_ending(path: Path, endings: Collection[str]) -> str:
    """Return a file's extension in lower case; ``ValueError`` if it is not in ``endings``."""
    suffix = path.suffix.lower()
    if suffix not in endings:
        known = " ".join(sorted(endings))
        raise ValueError(f"{path}: expected one of the endings {known}, got {suffix or 'none'}")
    return suffix


def check_output(path: str | os.PathLike[str], endings: Collection[str]) -> None:
    """Raise what writing to ``path`` would raise, before hours of work are done.

    Parameters
    ----------
    path : path-like
        The file to be written.
    endings : collection of str
        Allowed extensions, ``CLOUD_OUTPUTS`` or ``MESH_OUTPUTS``; empty allows any.

    Raises
    ------
    OSError
        The folder is missing or not writable.
    ValueError
        The extension is not allowed, or ``path`` is not a regular file.
    """
    path = Path(path)
    if endings:
        check_ending(path, endings)
    target = _target(path)
    name = _name_beside(target)
    try:
        _create(name, target).close()
        _remove(name)
    except BaseException:  # a signal may come before the file is removed
        _remove(name)
        raise


def check_different(
    inputs: Iterable[str | os.PathLike[str]], outputs: Iterable[str | os.PathLike[str]]
) -> None:
    """Raise ``ValueError`` if an output is also an input or another output, under any name."""
    named = {_identity(Path(each)): each for each in inputs}
    for output in outputs:
        other = named.setdefault(_identity(Path(output)), output)
        if other is not output:
            raise ValueError(f"{output}: expected another file than {other}, got the same")


def _identity(path: Path) -> tuple[int, int] | str:
    """Return an identity that is the same for all names of a file."""
    try:
        found = path.stat()
    except (OSError, ValueError):  # not there
        return os.path.realpath(path)
    return found.st_dev, found.st_ino


@contextlib.contextmanager
def open_atomic(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a binary stream whose contents appear at ``path`` when the block ends without error.

    The file is written under a temporary name in the same folder, flushed to disk, then renamed. If
    the block ends early, also by Ctrl-C, the temporary file is removed and ``path`` is unchanged.

    Parameters
    ----------
    path : path-like
        The file to be written or replaced; a link is followed.

    Yields
    ------
    binary stream
        A seekable stream for writing.

    Raises
    ------
    OSError
        The folder is missing or not writable, or the disk is full.
    ValueError
        ``path`` exists and is not a regular file.
    """
    target = _target(Path(path))
    name = _name_beside(target)
    try:
        # Created here, so that there is a name to remove whenever a signal arrives.
        with _create(name, target) as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(name, target)
    except BaseException as error:
        _remove(name)
        if isinstance(error, OSError):
            _rename_in_message(error, target)
        raise


def _target(path: Path) -> Path:
    """Follow links, and reject what a rename would destroy (a device, a folder)."""
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        kind = "a folder" if target.is_dir() else "a device or pipe"
        raise ValueError(f"{path}: expected a regular file or a new name, got {kind}")
    return target


def _name_beside(target: Path) -> Path:
    """Return an unused, hidden, sufficiently short name in the folder of ``target``."""
    return target.with_name(f".o3d-sofnn-{secrets.token_hex(8)}.part")


def _create(name: Path, target: Path) -> BinaryIO:
    """Create the file ``name`` with the permissions of ``target``."""
    try:
        stream = name.open("x+b")
    except OSError as error:
        _rename_in_message(error, target)
        raise
    if target.exists():
        name.chmod(stat.S_IMODE(target.stat().st_mode))
    return stream


def _remove(name: Path) -> None:
    with contextlib.suppress(OSError):  # not there, or no folder at all
        name.unlink()


def _rename_in_message(error: OSError, target: Path) -> None:
    """Make the message name the file that the user asked for, not the temporary one or none."""
    error.filename = str(target)
    del error.filename2  # None would be a second name
