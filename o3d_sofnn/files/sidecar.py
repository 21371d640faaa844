"""Coordinate systems beside files that cannot contain them: ``scan.prj`` for ``scan.ply``."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from o3d_sofnn.files.outputs import check_different, check_output, open_atomic
from o3d_sofnn.files.regular import open_regular

_logger = logging.getLogger(__name__)


_LONGEST = 2**16


# What well-known text begins with, of both versions.
_WKT = re.compile(r"\s*[A-Z_]+(CS|CRS|CRD|COORDSYS)\s*\[", re.ASCII)


def place_of(path: str | os.PathLike[str]) -> Path:
    """Return the name of the file with the coordinate system of ``path``."""
    return Path(path).with_suffix(".prj")


def read(path: Path) -> tuple[str | None, tuple[str, ...]]:
    """Return the coordinate system beside a file, and a note if there is something else."""
    place = place_of(path)
    if not os.path.isfile(place):
        return None, ()
    try:
        with open_regular(place) as stream:
            text = stream.read(_LONGEST).decode("utf-8-sig").strip()
    except (OSError, ValueError):
        text = ""
    if _WKT.match(text) is None:
        return None, (f"{place.name} left out: no coordinate system as WKT",)
    return text, ()


def as_wkt(crs: str) -> str | None:
    """Return a coordinate system as well-known text; None for a number without pyproj."""
    if not crs.startswith("EPSG:"):
        return crs
    pyproj = _import_pyproj()
    if pyproj is None:
        return None
    try:
        text: str | None = pyproj.CRS.from_user_input(crs).to_wkt("WKT1_GDAL")
    except RuntimeError:  # a number that it does not know
        return None
    return text


def not_kept(crs: str) -> str:
    """Return the message about a coordinate system without well-known text."""
    reason = "for its text type: pip install pyproj"
    if _import_pyproj() is not None:
        reason = "pyproj does not know it"
    return f"not kept: coordinate system {crs}; {reason}"


def _import_pyproj() -> Any:
    try:
        import pyproj
    except ModuleNotFoundError:
        return None
    return pyproj


def check(path: Path, crs: str | None, others: Iterable[str | os.PathLike[str]]) -> None:
    """Raise what :func:`write` would raise, before the work is done.

    Parameters
    ----------
    path : pathlib.Path
        The output.
    crs : str or None
        Coordinate system of the output; None if it has none.
    others : iterable of path-like
        Files that must not be overwritten.

    Raises
    ------
    ValueError
        A different file is already there, or it is one of ``others``.
    OSError
        The file cannot be written.
    """
    place = place_of(path)
    if crs is None:
        if place.exists():
            _logger.warning("%s: is there, but the points have no coordinate system", place)
        return
    check_different(others, [place])
    check_output(place, ())
    text = as_wkt(crs)
    if text is not None and place.exists() and read(path)[0] != text.strip():
        raise ValueError(f"{place}: expected the coordinate system of the points, got another")


def write(path: Path, crs: str) -> None:
    """Write the coordinate system of ``path`` beside it; log it if it cannot be written."""
    text = as_wkt(crs)
    if text is None:
        _logger.warning("%s: %s", path, not_kept(crs))
        return
    with open_atomic(place_of(path)) as stream:
        stream.write(text.encode())
