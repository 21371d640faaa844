"""The command line ``o3d-sofnn normals|reconstruct IN OUT`` and ``compare IN... --out DIR``."""

from __future__ import annotations

import argparse
import contextlib
import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from o3d_sofnn.cli import commands
from o3d_sofnn.compare import command
from o3d_sofnn.progress import make_progress

FAILURE = 1


BAD_INPUT = 2


INTERRUPTED = 130  # what a shell reports for a program that Ctrl-C ended


_EXIT_CODES = """\
exit codes: 0 done, 2 bad input or options, 1 other failures (a full disk), 130 Ctrl-C.
OUT is written whole or not at all."""


_NORMALS = """\
Write the points of IN with oriented normals to OUT. Normals face outward, those of open sheets to
the side from which they look convex, or as --viewpoint or --towards say. No option is needed."""


_NORMALS_FILES = """\
IN: ply pcd npy npz xyz xyzn xyzrgb txt csv asc pts ptx e57 las laz, the vertices of obj off stl
gltf glb fbx. What is in the file and not used is said.
OUT: ply pcd xyz xyzn npz las laz; points and their order are those of IN.
"""


_RECONSTRUCT = """\
Write a closed mesh through the points of IN to OUT. Normals in IN are not needed. For rooms and
other open surfaces add --trim auto, for terrain also --towards 0 0 1. No option is needed."""


_RECONSTRUCT_FILES = """\
IN: ply pcd npy npz xyz xyzn xyzrgb txt csv asc pts ptx e57 las laz, the vertices of obj off stl
gltf glb fbx. What is in the file and not used is said.
OUT: ply obj (with vertex normals, and colours where IN has them), off (with colours), stl.
"""


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
        logging.getLogger("laspy").setLevel(logging.CRITICAL)  # one line on errors: ours
        with contextlib.closing(make_progress(args.progress)) as progress:
            if args.command == "compare":
                return command.run(args, progress)
            report = commands.run(args, progress)
        commands.write_report(report, args.json)
    except KeyboardInterrupt:
        return _complain(INTERRUPTED, "interrupted")
    except ValueError as error:
        return _complain(BAD_INPUT, _as_typed(str(error), args))
    except MemoryError:
        return _complain(FAILURE, "not enough memory")
    except OSError as error:
        known = error.filename is not None and error.strerror is not None
        return _complain(FAILURE, f"{error.filename}: {error.strerror}" if known else str(error))
    except (ImportError, RuntimeError) as error:
        return _complain(FAILURE, str(error))
    return 0


def _as_typed(message: str, args: argparse.Namespace) -> str:
    """Let a message name what was typed: an option of the shell, or the file of the points."""
    name, _, rest = message.partition(": ")
    if name == "pcd":
        return f"{args.input}: {rest}"
    if message.startswith("points "):
        return f"{args.input}: {message}"
    option = name.removeprefix("n_")
    return f"--{option.replace('_', '-')}: {rest}" if option in vars(args) else message


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
    _add_normals(commands, common)
    _add_reconstruct(commands, common)
    _add_compare(commands)
    return parser


def _add_command(
    commands: Any, common: argparse.ArgumentParser, name: str, purpose: str, text: str, files: str
) -> argparse.ArgumentParser:
    """Add a command that reads points from a file and writes another one."""
    parser: argparse.ArgumentParser = commands.add_parser(
        name,
        parents=[common],
        help=purpose,
        description=text,
        epilog=files + _EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    return parser


def _add_normals(commands: Any, common: argparse.ArgumentParser) -> None:
    purpose = "write the points of IN with normals to OUT"
    _add_side(_add_command(commands, common, "normals", purpose, _NORMALS, _NORMALS_FILES))


def _add_reconstruct(commands: Any, common: argparse.ArgumentParser) -> None:
    purpose = "write a watertight mesh through the points to OUT"
    mesh = _add_command(commands, common, "reconstruct", purpose, _RECONSTRUCT, _RECONSTRUCT_FILES)
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
        "--precision",
        type=float,
        metavar="E",
        help="largest distance of the local surfaces from the points, in the unit of IN",
    )
    _add_side(mesh).add_argument(
        "--use-normals", action="store_true", help="take the sides from the normals in IN"
    )


def _add_compare(commands: Any) -> None:
    compare = commands.add_parser(
        "compare",
        help="compare with Open3D's and MeshLab's reconstructions",
        description=command.TEXT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    compare.add_argument("input", type=Path, nargs="+", metavar="IN", help="scans, closed meshes")
    command.add_options(compare)
    _add_progress(compare)


def _add_side(parser: argparse.ArgumentParser) -> argparse._MutuallyExclusiveGroup:
    side = parser.add_mutually_exclusive_group()
    side.add_argument(
        "--viewpoint",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="the scanner's position: everything faces it",
    )
    side.add_argument(
        "--towards",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="a direction that every piece faces: 0 0 1 for terrain, its solid is below",
    )
    return side


def _number_or_auto(text: str) -> float | str:
    try:
        return text if text == "auto" else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"expected a number from 0 to 1 or auto, got {text!r}"
        ) from None


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
