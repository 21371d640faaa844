"""``o3d-sofnn normals`` and ``o3d-sofnn reconstruct``: from file to file, with a report."""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from o3d_sofnn.cli import streams
from o3d_sofnn.cli.jobs import Job
from o3d_sofnn.progress import ProgressCallback, rescale

if TYPE_CHECKING:
    from o3d_sofnn.files.columns import PointFile


_logger = logging.getLogger(__name__)


# Share of the progress that reading takes, and where writing starts.
_READ_DONE = 0.05


_WRITE_STARTS = 0.95


# Python with NumPy and SciPy (and Open3D for comparisons) maps about 500 MB before it does
# anything. With less, or without room for its threads, OpenBLAS ends the process or hangs while it
# is loaded.
_LEAST_MEMORY = 512 * 2**20


def load(command: str) -> None:
    """Import what a command needs, in one place: it takes seconds, and signals must wait.

    Raises
    ------
    ImportError
        Open3D, which comparisons need, is missing; the message says what to type.
    MemoryError
        The memory limit of this process is too low for the libraries.
    """
    limit = _memory_limit()
    if limit is not None:
        if limit < _LEAST_MEMORY:
            raise MemoryError(
                f"{limit >> 20} MB are allowed, {_LEAST_MEMORY >> 20} MB are needed to begin with"
            )
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from o3d_sofnn.operators import normals, surfaces  # noqa: F401

    if command == "compare":
        from o3d_sofnn import adapters
        from o3d_sofnn.compare import run  # noqa: F401

        adapters.import_open3d()


def _memory_limit() -> int | None:
    """Return the limit of this process's address space, in bytes."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    return None if limit == resource.RLIM_INFINITY else limit


def run(args: argparse.Namespace, job: Job, progress: ProgressCallback) -> dict[str, Any]:
    """Read, compute, and write one file.

    Parameters
    ----------
    args : argparse.Namespace
        Arguments from the parser of :mod:`o3d_sofnn.cli.main`.
    job : Job
        The files; outputs have been checked.
    progress : callable
        Called with the fraction done and the current stage.

    Returns
    -------
    dict
        The report.

    Raises
    ------
    ValueError
        An option is out of range, or the input is unsuitable; the message names it.
    OSError
        The output cannot be written.
    """
    started = time.perf_counter()
    # Imported here, so that --help and bad options respond at once.
    from o3d_sofnn.cli import findings, georeference
    from o3d_sofnn.files import point_files
    from o3d_sofnn.operators.common import unwarned

    mesh_wanted = args.command == "reconstruct"
    options = {
        "max_nn": args.max_nn,
        "radius": args.radius,
        "n_threads": args.threads,
        "print_progress": rescale(progress, _READ_DONE, _WRITE_STARTS),
        "return_details": True,
        "viewpoint": args.viewpoint,
        "towards": args.towards,
    }
    progress(0.0, "read")
    seconds: dict[str, float] = {}
    with _timed(seconds, "read"):
        if job.is_from_stream:
            streams.read_file(job.source)
        source = read(job.source, job.ending)
    if not mesh_wanted:
        names = findings.ATTRIBUTES if args.attributes else ()
        point_files.check_contents(job.target, source, job.source, names)
    place = georeference.place_of(args, job, source)
    for note in source.notes:
        _logger.warning("%s: %s", job.source, note)
    if uses_viewpoint_of(source, args):
        options["viewpoint"] = source.viewpoint
        _logger.info("%s: the scanner's place in the file is used", job.source)
    cloud = point_files.as_cloud(source)
    with unwarned():
        result, details = (_reconstruct if mesh_wanted else _normals)(cloud, args, options)
    seconds |= details.seconds
    progress(_WRITE_STARTS, "write")
    extra = findings.attributes(details) if args.attributes else None
    result = place.moved(result)
    with _timed(seconds, "write"):
        if mesh_wanted:
            point_files.write_triangle_mesh(job.target, result, extra=extra, crs=place.crs)
        else:
            point_files.write_point_cloud(
                job.target, result, template=job.source, extra=extra, crs=place.crs
            )
        if job.is_to_stream:
            streams.write_file(job.target)
    progress(1.0, "done")
    seconds["total"] = time.perf_counter() - started
    report: dict[str, Any] = {"command": args.command, **job.report}
    report |= findings.figures(source, details)
    report["crs"] = source.crs
    report["offset"] = None if place.offset is None else place.offset.tolist()
    report["viewpoint_of_file"] = uses_viewpoint_of(source, args)
    report["seconds"] = {name: round(value, 4) for name, value in seconds.items()}
    return report


def write_report(report: dict[str, Any] | list[dict[str, Any]], destination: str | None) -> None:
    """Write a report, or those of several files, as JSON.

    Parameters
    ----------
    report : dict or list of dict
        Results of :func:`run`.
    destination : str or None
        A file, or "-" for the standard output stream; None writes nothing.
    """
    text = json.dumps(report, indent=2, allow_nan=False) + "\n"
    if destination == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
    elif destination is not None:
        from o3d_sofnn.files import point_files

        with point_files.open_atomic(destination) as stream:
            stream.write(text.encode())


def closed_of(args: argparse.Namespace) -> bool | Literal["auto"]:
    """Return what ``--closed`` says."""
    chosen: dict[str, bool | Literal["auto"]] = {"yes": True, "no": False}
    return chosen.get(args.closed, "auto")


def read(path: Path, ending: str | None) -> PointFile:
    """Read an input; errors in it count as bad input, not as failures of the machine."""
    from o3d_sofnn.files import point_files

    try:
        source = point_files.read_points(path, ending)
    except OSError as error:
        # A file may refer to another one.
        named = error.filename or path
        raise ValueError(f"{named}: not readable: {error.strerror or error}") from error
    if len(source.points) == 0:
        raise ValueError(f"{path}: expected points, got none")
    return source


def uses_viewpoint_of(source: PointFile, args: argparse.Namespace) -> bool:
    """Return whether the scanner's position in the file decides the sides: no option does."""
    said = args.viewpoint is not None or args.towards is not None or args.no_viewpoint
    return source.viewpoint is not None and not said and not getattr(args, "use_normals", False)


def _normals(cloud: Any, args: argparse.Namespace, options: dict[str, Any]) -> Any:
    from o3d_sofnn.operators.normals import estimate_normals

    return estimate_normals(cloud, **options)


def _reconstruct(cloud: Any, args: argparse.Namespace, options: dict[str, Any]) -> Any:
    from o3d_sofnn.operators.surfaces import reconstruct_surface

    *mesh, details = reconstruct_surface(
        cloud,
        depth=args.depth,
        voxel_size=args.voxel_size,
        use_normals=args.use_normals,
        closed=closed_of(args),
        trim=args.trim,
        target_triangles=args.target_triangles,
        precision=args.precision,
        **options,
    )
    return tuple(mesh), details


@contextlib.contextmanager
def _timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    started = time.perf_counter()
    yield
    seconds[name] = time.perf_counter() - started
