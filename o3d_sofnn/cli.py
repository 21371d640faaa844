"""The command line ``o3d-sofnn normals|reconstruct IN OUT`` and ``compare IN... --out DIR``."""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

from o3d_sofnn.compare import command
from o3d_sofnn.progress import Progress, make_progress, rescale

FAILURE = 1
BAD_INPUT = 2
INTERRUPTED = 130  # what a shell reports for a program that Ctrl-C ended

# Share of the progress that reading takes, and where writing starts.
_READ_DONE = 0.05
_WRITE_STARTS = 0.95

_EXIT_CODES = """\
exit codes: 0 done, 2 bad input or options, 1 other failures (a full disk), 130 Ctrl-C.
OUT is written whole or not at all."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    argv : sequence of str, optional
        Arguments without the program's name; None takes those of the process.

    Returns
    -------
    int
        The exit code: 0 done, 2 bad input or options, 1 other failures, 130 after Ctrl-C.
    """
    try:
        args = _parser().parse_args(argv)
        logging.basicConfig(format="o3d-sofnn: %(levelname)s: %(message)s", force=True)
        with contextlib.closing(make_progress(args.progress)) as progress:
            if args.command == "compare":
                return command.run(args, progress)
            report = _run(args, progress)
        _write_report(report, args.json)
    except KeyboardInterrupt:
        return _complain(INTERRUPTED, "interrupted")
    except ValueError as error:
        return _complain(BAD_INPUT, str(error))
    except MemoryError:
        return _complain(FAILURE, "not enough memory")
    except (OSError, ImportError, RuntimeError) as error:
        return _complain(FAILURE, str(error))
    return 0


def _run(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Read, compute, write; return the report."""
    started = time.perf_counter()
    progress(0.0, "load")
    # Imported here: --help and bad options answer at once, and Ctrl-C during the import is caught.
    from o3d_sofnn import adapters, io, operators, validation

    reconstruct = args.command == "reconstruct"
    io.check_output(args.output, io.MESH_OUTPUTS if reconstruct else io.CLOUD_OUTPUTS)
    if args.json not in (None, "-"):
        io.check_output(args.json, ())
    search_param = adapters.make_search_param(args.max_nn, args.radius)

    progress(0.0, "read")
    seconds: dict[str, float] = {}
    with _timed(seconds, "read"):
        cloud = _read(args.input)
    options = {
        "search_param": search_param,
        "n_threads": args.threads,
        "print_progress": rescale(progress, _READ_DONE, _WRITE_STARTS),
        "return_details": True,
    }
    if reconstruct:
        result, details = operators.reconstruct_surface(
            cloud,
            depth=args.depth,
            voxel_size=args.voxel_size,
            use_normals=args.use_normals,
            trim=args.trim,
            target_triangles=args.target_triangles,
            **options,
        )
    else:
        result, details = operators.estimate_normals(
            cloud, viewpoint=args.viewpoint, towards=args.towards, **options
        )
    progress(_WRITE_STARTS, "write")
    with _timed(seconds, "write"):
        if reconstruct:
            io.write_triangle_mesh(args.output, result)
        else:
            io.write_point_cloud(args.output, result, template=args.input)
    progress(1.0, "done")
    normals = details.normals if reconstruct else details
    # In the details a point without finite coordinates counts as an outlier too.
    not_finite = int((~validation.finite_rows(adapters.read_cloud(cloud).points)).sum())
    report = {
        "command": args.command,
        "input": str(args.input),
        "output": str(args.output),
        "points": len(normals.normals),
        "not_finite": not_finite,
        "outliers": int(normals.outliers.sum()) - not_finite,
        "rules": len(normals.rules.centers),
        "noise_level": float(normals.noise_level),
        "spacing": float(normals.spacing),
        "warnings": list(normals.warnings),
    }
    if reconstruct:
        report |= {
            "vertices": len(details.vertices),
            "triangles": len(details.triangles),
            "watertight": bool(details.watertight),
        }
    stages = {"read": seconds["read"], **details.seconds, "write": seconds["write"]}
    stages["total"] = time.perf_counter() - started
    report["seconds"] = {name: round(value, 4) for name, value in stages.items()}
    return report


def _read(path: Path) -> Any:
    """Read the input; what is wrong with it is bad input, not a failure of the machine."""
    from o3d_sofnn import io

    try:
        cloud = io.read_point_cloud(path)
    except OSError as error:
        raise ValueError(f"{path}: not readable: {error.strerror or error}") from error
    if cloud.is_empty():
        raise ValueError(f"{path}: expected points, got none")
    return cloud


def _write_report(report: dict[str, Any], destination: str | None) -> None:
    text = json.dumps(report, indent=2, allow_nan=False) + "\n"
    if destination == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
    elif destination is not None:
        from o3d_sofnn import io

        with io.open_atomic(destination) as stream:
            stream.write(text.encode())


@contextlib.contextmanager
def _timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    started = time.perf_counter()
    yield
    seconds[name] = time.perf_counter() - started


def _complain(code: int, message: str) -> int:
    """Write one line and return ``code``."""
    sys.stderr.write(f"o3d-sofnn: error: {' '.join(message.split())}\n")
    return code


class _Parser(argparse.ArgumentParser):
    """A parser whose complaint is one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"o3d-sofnn: error: {message} (see {self.prog} --help)\n")


class _Version(argparse.Action):
    """Print the version; found only when asked for, because looking it up takes time."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        import o3d_sofnn

        sys.stdout.write(f"o3d-sofnn {o3d_sofnn.__version__}\n")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="o3d-sofnn",
        description="Oriented normals and watertight meshes from raw point clouds.",
        epilog=_EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    common = _common_options()
    normals = commands.add_parser(
        "normals", parents=[common], help="write the points of IN with normals to OUT"
    )
    side = normals.add_mutually_exclusive_group()
    side.add_argument(
        "--viewpoint",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="the scanner's position: normals face it",
    )
    side.add_argument(
        "--towards",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="a direction that normals face: 0 0 1 for terrain",
    )
    mesh = commands.add_parser(
        "reconstruct", parents=[common], help="write a watertight mesh through the points to OUT"
    )
    resolution = mesh.add_mutually_exclusive_group()
    resolution.add_argument(
        "--depth", type=int, metavar="D", help="2**D cells along the longest side (1 to 16)"
    )
    resolution.add_argument(
        "--voxel-size", type=float, metavar="L", help="side of a cell, in the unit of IN"
    )
    mesh.add_argument(
        "--trim",
        type=_number_or_auto,
        metavar="T",
        help="cut away what has a confidence (0 to 1) below T; auto: 0.5, small holes stay closed",
    )
    mesh.add_argument(
        "--target-triangles", type=int, metavar="N", help="decimate to N triangles, still closed"
    )
    mesh.add_argument(
        "--use-normals", action="store_true", help="take the sides from the normals in IN"
    )
    compare = commands.add_parser(
        "compare",
        help="compare with Open3D's and MeshLab's reconstructions",
        description=command.TEXT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    compare.add_argument("input", type=Path, nargs="+", metavar="IN", help="scans, closed meshes")
    command.add_options(compare)
    _add_progress(compare)
    return parser


def _number_or_auto(text: str) -> float | str:
    return text if text == "auto" else float(text)


def _add_progress(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--progress",
        choices=("auto", "bar", "plain", "none"),
        default="auto",
        help="auto (default): a bar on a terminal; plain: lines 'PROGRESS percent text'",
    )


def _common_options() -> _Parser:
    common = _Parser(add_help=False)
    common.add_argument("input", type=Path, metavar="IN", help="a point file (ply pcd xyz las ...)")
    common.add_argument("output", type=Path, metavar="OUT", help="the file to write")
    common.add_argument(
        "--max-nn", type=int, metavar="K", help="largest neighbourhood of a local fit, in points"
    )
    common.add_argument(
        "--radius", type=float, metavar="R", help="the same as a radius, in the unit of IN"
    )
    common.add_argument(
        "--threads", type=int, default=-1, metavar="N", help="threads; -1 (default): all cores"
    )
    _add_progress(common)
    common.add_argument("--json", metavar="REPORT", help="write a report as JSON; - for the screen")
    return common
