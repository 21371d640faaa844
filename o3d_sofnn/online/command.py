"""``o3d-sofnn watch``, and ``reconstruct`` of several sweeps of one object."""

from __future__ import annotations

import argparse
import logging
import time
from pathlib import Path
from typing import Any

from o3d_sofnn.progress import ProgressCallback, rescale

TEXT = """\
Write the mesh of all point files in DIR to OUT, and again after each file that a scanner drops
there: each is a sweep of the same object. OUT is replaced as a whole. A file is read when its size
has not changed for a while; a file that cannot be read is named and left out.
Ends after --idle seconds without a new file, or with Ctrl-C."""


PASSED = ("max_nn", "radius", "depth", "voxel_size", "trim", "precision", "towards")
"""Options of the surface that are called the same in Python."""


SETTLED = 0.5
"""Seconds between two looks at the folder: a file that has the same size at both is complete."""


_logger = logging.getLogger(__name__)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``watch`` that other commands do not have."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="where point files arrive")
    parser.add_argument("output", metavar="OUT", help="the mesh: ply obj off stl gltf glb")
    ends = parser.add_mutually_exclusive_group()
    ends.add_argument(
        "--once", action="store_true", help="take the files that are there, and do not wait"
    )
    ends.add_argument(
        "--idle", type=float, metavar="S", help="end after S seconds without a new file"
    )
    parser.add_argument(
        "--target-triangles", type=int, metavar="N", help="decimate to N triangles, still closed"
    )
    parser.add_argument("--json", metavar="REPORT", help="write a report as JSON; - for the screen")


class Sweeps:
    """Files that become one surface."""

    def __init__(self, args: argparse.Namespace, ending: str | None = None) -> None:
        from o3d_sofnn.cli import commands
        from o3d_sofnn.operators.online import OnlineReconstruction

        options: dict[str, Any] = {name: getattr(args, name) for name in PASSED}
        self.model = OnlineReconstruction(
            closed=commands.closed_of(args),
            n_threads=args.threads,
            target_triangles=args.target_triangles,
            **options,
        )
        self.files: list[str] = []
        self.crs: str | None = None
        self._args, self._ending = args, ending

    def add(self, path: Path) -> None:
        """Add the points of a file, seen from the place that the user or the file says."""
        from o3d_sofnn.cli import commands
        from o3d_sofnn.files import point_files

        source = commands.read(path, self._ending)
        for note in source.notes:
            _logger.warning("%s: %s", path, note)
        place = self._args.viewpoint
        if commands.uses_viewpoint_of(source, self._args):
            place = source.viewpoint
        self.model.add(point_files.as_cloud(source), place)
        self.crs = self.crs or source.crs
        self.files.append(str(path))

    def write(self, path: Path) -> dict[str, Any]:
        """Write the mesh of all files so far, and return a report."""
        from o3d_sofnn.files import point_files

        vertices, triangles, details = self.model.mesh(return_details=True)
        point_files.write_triangle_mesh(path, (vertices, triangles), crs=self.crs)
        return {
            "inputs": list(self.files),
            "output": str(path),
            "cells": len(self.model),
            "vertices": len(details.vertices),
            "triangles": len(triangles),
            "quality": str(details.quality),
            "turned": self.model.turned.tolist(),
            "warnings": list(details.warnings),
        }


def are_sweeps(args: argparse.Namespace) -> bool:
    """Return whether several inputs of ``reconstruct`` are to become one file."""
    from o3d_sofnn.cli import jobs
    from o3d_sofnn.files import point_files

    if args.command != "reconstruct" or jobs.STREAM in (*args.input, args.output):
        return False
    if jobs.STEM in args.output or Path(args.output).suffix.lower() not in point_files.MESH_OUTPUTS:
        return False
    return (
        not Path(args.output).is_dir()
        and len(jobs.found(args.input, jobs.input_ending(args.input_format))) > 1
    )


def reconstruct(args: argparse.Namespace, progress: ProgressCallback) -> int:
    """Write the mesh of several files; return the exit code."""
    from o3d_sofnn.cli import commands, jobs
    from o3d_sofnn.files import outputs, point_files
    from o3d_sofnn.operators.common import unwarned

    for name in ("use_normals", "attributes", "offset"):
        if getattr(args, name):
            option = name.replace("_", "-")
            raise ValueError(f"--{option}: expected a single IN for it, got several for one OUT")
    started = time.perf_counter()
    ending = jobs.input_ending(args.input_format)
    files = [Path(each) for each in jobs.found(args.input, ending)]
    target = Path(args.output)
    outputs.check_output(target, point_files.MESH_OUTPUTS)
    reports = [] if args.json in (None, jobs.STREAM) else [args.json]
    point_files.check_different(files, [target, *reports])
    sweeps = Sweeps(args, ending)
    for number, file in enumerate(files):
        rescale(progress, 0.0, 0.3)(number / len(files), f"read {file.name}")
        sweeps.add(file)
    progress(0.3, "reconstruct")
    with unwarned():
        report = sweeps.write(target)
    progress(1.0, "done")
    report["seconds"] = round(time.perf_counter() - started, 3)
    commands.write_report({"command": "reconstruct", **report}, args.json)
    return 0


def watch(args: argparse.Namespace, progress: ProgressCallback) -> int:
    """Follow a folder; return the exit code."""
    from o3d_sofnn.cli import commands
    from o3d_sofnn.files import outputs, point_files

    if not args.folder.is_dir():
        raise ValueError(f"{args.folder}: expected a folder")
    if args.idle is not None and not args.idle > 0.0:
        raise ValueError(f"--idle: expected a positive number, got {args.idle:g}")
    target = Path(args.output)
    outputs.check_output(target, point_files.MESH_OUTPUTS)
    sweeps, seen = Sweeps(args), set[Path]()
    sizes: dict[Path, tuple[int, int]] = {}
    last, report = time.monotonic(), None
    while True:
        before, sizes = sizes, _sizes(args.folder, target, point_files.CLOUD_INPUTS)
        ready = [f for f, size in sizes.items() if f not in seen and before.get(f) == size]
        for file in ready:
            seen.add(file)
            last = time.monotonic()
            report = _taken(sweeps, file, target, progress) or report
        waiting = any(file not in seen for file in sizes)
        if args.once and not waiting:
            break
        if args.idle is not None and not waiting and time.monotonic() - last > args.idle:
            break
        progress(1.0 if report else 0.0, f"{len(sweeps.files)} files, waiting for more")
        time.sleep(SETTLED)
    if report is None:
        raise ValueError(f"{args.folder}: expected point files in it, got none that make a surface")
    progress(1.0, "done")
    commands.write_report({"command": "watch", **report}, args.json)
    return 0


def _taken(
    sweeps: Sweeps, file: Path, target: Path, progress: ProgressCallback
) -> dict[str, Any] | None:
    """Add a file and write the mesh; say what went wrong, and return None."""
    from o3d_sofnn.operators.common import unwarned

    progress(0.0, f"read {file.name}")
    try:
        sweeps.add(file)
    except ValueError as error:
        _logger.warning("%s: left out: %s", file, str(error).removeprefix(f"{file}: "))
        return None
    progress(0.1, f"{len(sweeps.files)} files")
    try:
        with unwarned():
            return sweeps.write(target)
    except ValueError as error:
        _logger.warning("no mesh yet: %s", error)
        return None


def _sizes(folder: Path, target: Path, endings: Any) -> dict[Path, tuple[int, int]]:
    """Return size and time of the point files in a folder, in the order of their names."""
    found = {}
    for file in sorted(folder.iterdir()):
        hidden = file.name.startswith(".") or file.resolve() == target.resolve()
        if hidden or file.suffix.lower() not in endings:
            continue
        try:
            status = file.stat()
        except OSError:  # removed meanwhile
            continue
        if status.st_size and file.is_file():
            found[file] = status.st_size, status.st_mtime_ns
    return found
