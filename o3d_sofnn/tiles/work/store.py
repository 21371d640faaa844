"""The work directory of a run: files written whole, with checksums, and what is finished."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.files.outputs import open_atomic

MANIFEST = "manifest.jsonl"
"""One JSON line for each finished file: its name, length and SHA-256; the first line is the job."""


@dataclass(frozen=True)
class Receipt:
    """A finished file.

    Attributes
    ----------
    name : str
        Its name in the work directory.
    size : int
        Length in bytes.
    sha256 : str
        Checksum.
    told : dict
        What else the task has to say, as JSON; under "also", receipts of other files that it made.
    """

    name: str
    size: int
    sha256: str
    told: dict[str, Any] = field(default_factory=dict)

    def holds(self, folder: Path) -> bool:
        """Return whether the file and those made with it are there and have their checksums."""
        path = folder / self.name
        also = [Receipt(**each) for each in self.told.get("also", ())]
        return (
            all(each.holds(folder) for each in also)
            and path.is_file()
            and path.stat().st_size == self.size
            and _sum(path) == self.sha256
        )


def save_arrays(folder: Path, name: str, arrays: Mapping[str, Any], **told: Any) -> Receipt:
    """Write arrays to a file of the work directory, whole or not at all."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    with open_atomic(path) as stream:
        np.savez(stream, **arrays)
    return receipt(folder, name, **told)


def load_arrays(folder: Path, name: str) -> dict[str, NDArray[Any]]:
    """Read the arrays of such a file."""
    with np.load(folder / name) as found:
        return {key: found[key] for key in found.files}


def save_object(folder: Path, name: str, value: Any, **told: Any) -> Receipt:
    """Write an object that the package itself reads again."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    with open_atomic(path) as stream:
        pickle.dump(value, stream, protocol=4)
    return receipt(folder, name, **told)


def load_object(folder: Path, name: str) -> Any:
    """Read such an object."""
    with (folder / name).open("rb") as stream:
        return pickle.load(stream)


def receipt(folder: Path, name: str, **told: Any) -> Receipt:
    """Return the receipt of a file that is there."""
    path = folder / name
    return Receipt(name, path.stat().st_size, _sum(path), told)


def _sum(path: Path) -> str:
    total = hashlib.sha256()
    with path.open("rb") as stream:
        while part := stream.read(1 << 20):
            total.update(part)
    return total.hexdigest()


class Manifest:
    """What is finished of a job.

    Parameters
    ----------
    folder : Path
        The work directory; created if needed.
    job : dict
        Inputs and options, as JSON: a directory serves one job.

    Raises
    ------
    ValueError
        The directory has files of another job.
    """

    def __init__(self, folder: Path, job: Mapping[str, Any]) -> None:
        self.folder, self._path = folder, folder / MANIFEST
        folder.mkdir(parents=True, exist_ok=True)
        self._known: dict[str, Receipt] = {}
        wanted = json.loads(json.dumps(job))
        lines = self._path.read_text().splitlines() if self._path.exists() else []
        if lines:
            if _read(lines[0]) != wanted:
                raise ValueError(
                    f"{folder}: expected the work directory of this job, got one of other inputs "
                    "or options: remove it, or choose another --out"
                )
            # A line that was cut short is of a file that counts as unfinished.
            found = [Receipt(**each) for each in map(_read, lines[1:]) if each is not None]
            self._known = {each.name: each for each in found if each.holds(folder)}
        else:
            self._append(wanted)

    def __contains__(self, name: str) -> bool:
        """Return whether a file is finished."""
        return name in self._known

    def __getitem__(self, name: str) -> Receipt:
        """Return the receipt of a finished file."""
        return self._known[name]

    def add(self, receipt: Receipt) -> None:
        """Note that a file is finished."""
        self._known[receipt.name] = receipt
        self._append(vars(receipt))

    def _append(self, line: Mapping[str, Any]) -> None:
        try:
            with self._path.open("a") as stream:
                stream.write(json.dumps(line) + "\n")
                stream.flush()
                os.fsync(stream.fileno())
        except OSError as error:
            error.filename = str(self._path)
            raise


def _read(line: str) -> Any:
    try:
        return json.loads(line)
    except ValueError:
        return None
