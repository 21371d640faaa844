"""The file of an on-line reconstruction: its cells and its options, NPZ."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from o3d_sofnn.files.outputs import open_atomic
from o3d_sofnn.online.cells import Cells

FORMAT = 1
"""Version of the files."""

PREFIX = "option_"
"""Begins the names of options in a file."""


def write(path: str | os.PathLike[str], cells: Cells | None, options: dict[str, Any]) -> None:
    """Write cells and options, whole or not at all."""
    held = {} if cells is None else vars(cells)
    named = {f"{PREFIX}{name}": value for name, value in options.items()}
    with open_atomic(path) as stream:
        np.savez_compressed(stream, format=FORMAT, **named, **held)


def read(path: str | os.PathLike[str]) -> tuple[Cells | None, dict[str, Any]]:
    """Read cells and options.

    Raises
    ------
    ValueError
        The file holds something else.
    OSError
        It cannot be read.
    """
    try:
        with np.load(Path(path), allow_pickle=False) as file:
            stored = {name: file[name] for name in file.files}
        if int(stored.pop("format")) != FORMAT:
            raise ValueError("another version")
        names = [name for name in stored if name.startswith(PREFIX)]
        given = {name.removeprefix(PREFIX): stored.pop(name) for name in names}
        options = {name: value if value.ndim else value.item() for name, value in given.items()}
        if not stored:
            return None, options
        return Cells(float(stored.pop("edge")), **stored).checked(), options
    except (ValueError, EOFError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path}: expected a file of OnlineReconstruction.save") from error
