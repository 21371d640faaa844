"""Georeference of the points: the coordinate system, and an offset that is subtracted."""

from __future__ import annotations

import argparse
import logging
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.cli.jobs import STREAM, Job
from o3d_sofnn.files import las, sidecar
from o3d_sofnn.files.columns import PointFile
from o3d_sofnn.files.writers.origin import local_origin

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Place:
    """Georeference of the output.

    Attributes
    ----------
    offset : numpy.ndarray, shape (3,), or None
        Offset that is subtracted from the coordinates.
    crs : str or None
        Coordinate system of the output.
    """

    offset: NDArray[np.float64] | None
    crs: str | None

    def moved(self, result: Any) -> Any:
        """Subtract the offset from a cloud, or from vertices with triangles."""
        if self.offset is None:
            return result
        if isinstance(result, CloudArrays):
            return replace(result, points=result.points - self.offset)
        vertices, triangles = result
        return replace(vertices, points=vertices.points - self.offset), triangles


def place_of(args: argparse.Namespace, job: Job, source: PointFile) -> Place:
    """Return the georeference that the arguments request, and log what is not kept.

    Parameters
    ----------
    args : argparse.Namespace
        ``offset``: None, "auto" or three numbers; ``json``.
    job : Job
        The files.
    source : PointFile
        The contents of the input.

    Raises
    ------
    ValueError
        An offset is given for LAS, or there is a different coordinate system beside the output.
    OSError
        The coordinate system cannot be written beside the output.
    """
    is_las = job.target.suffix.lower() in las.FORMATS
    offset = crs = None
    if args.offset is not None:
        if is_las:
            raise ValueError(
                "--offset: expected another OUT than LAS or LAZ, which keep all digits"
            )
        offset = local_origin(source.points) if args.offset == "auto" else np.array(args.offset)
        shown = " ".join(f"{value:.15g}" for value in offset)
        also = "" if source.crs is None else "; their coordinate system is not kept"
        _logger.warning("%s: coordinates are those of IN less %s%s", job.target, shown, also)
    elif is_las or not job.is_to_stream:
        crs = source.crs
    elif source.crs is not None:
        _logger.warning("%s: not kept: the coordinate system; a file OUT keeps it", job.target)
    if not is_las and not job.is_to_stream:
        reports = [] if args.json in (None, STREAM) else [args.json]
        sidecar.check(job.target, crs, [job.source, job.target, *reports])
    return Place(offset, crs)
