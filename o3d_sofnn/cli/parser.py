"""The options of ``o3d-sofnn``, and their ``--help`` texts."""

from __future__ import annotations

import argparse
import math
import re
import sys
from pathlib import Path
from typing import Any, NoReturn

from o3d_sofnn.cli import comparison
from o3d_sofnn.online import command as online
from o3d_sofnn.progress import printable
from o3d_sofnn.tiles import command as tiles

BAD_INPUT = 2


_EXIT_CODES = """\
exit codes: 0 success, 2 bad input (also one of several) or options, 1 other failures (a full disk),
130 Ctrl-C; after other signals 128 plus their number.
OUT is written whole or not at all."""


_SEVERAL = """\
Several IN: files, folders (the point files directly in them), wildcards in quotes. OUT is then a
folder, created if needed, or a name with {stem}, the name of IN without its extension.
A file that fails does not stop the others. reconstruct with a single file as OUT takes several IN
as sweeps of one object.
-: the standard input as IN (with --input-format), the standard output as OUT (--output-format).
"""


_NORMALS = """\
Write the points of IN with oriented normals to OUT. Normals face outward; those of scans face
the scanner if the points reveal its position. --viewpoint and --towards overrule both. No option
is needed."""


_NORMALS_FILES = """\
IN: ply pcd npy npz xyz xyzn xyzrgb txt csv asc pts ptx e57 las laz, the vertices of obj off stl
gltf glb fbx. What is in the file and not used is said.
OUT: ply pcd xyz xyzn npz las laz; points and their order are those of IN.
"""


_RECONSTRUCT = """\
Write a mesh through the points of IN to OUT: solids are closed, everything else is open where
nothing was measured. Normals in IN are not needed. No option is needed."""


_RECONSTRUCT_FILES = """\
IN: ply pcd npy npz xyz xyzn xyzrgb txt csv asc pts ptx e57 las laz, the vertices of obj off stl
gltf glb fbx. What is in the file and not used is said.
OUT: ply obj glb (with vertex normals, and colours where IN has them), off (with colours), stl.
"""


class _Parser(argparse.ArgumentParser):
    """A parser with one-line errors that does not mistake numbers for options."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        # argparse mistakes -1e5 for an option.
        self._negative_number_matcher = re.compile(r"-(\.?\d|inf|nan)", re.IGNORECASE)

    def error(self, message: str) -> NoReturn:
        self.exit(BAD_INPUT, f"o3d-sofnn: error: {printable(message)} (see {self.prog} --help)\n")

    def parse_known_args(self, *args: Any) -> tuple[Any, list[str]]:  # type: ignore[override]
        """Allow options between files: argparse would reject files after an option."""
        found, left = super().parse_known_args(*args)
        if hasattr(found, "input_format") and all(each == "-" or each[:1] != "-" for each in left):
            files = [*found.input, found.output, *left]
            found.input, found.output, left = files[:-1], files[-1], []
        return found, left


class _Version(argparse.Action):
    """Print the version; it is looked up only on request, because that takes time."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        import o3d_sofnn

        sys.stdout.write(f"o3d-sofnn {o3d_sofnn.__version__}\n")
        parser.exit()


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands, which ends the process on bad arguments."""
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
    _add_large(commands)
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
        epilog=files + _SEVERAL + _EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    return parser


def _add_normals(commands: Any, common: argparse.ArgumentParser) -> None:
    purpose = "write the points of IN with normals to OUT"
    _add_side(_add_command(commands, common, "normals", purpose, _NORMALS, _NORMALS_FILES))


def _add_reconstruct(commands: Any, common: argparse.ArgumentParser) -> None:
    purpose = "write a watertight mesh through the points to OUT"
    mesh = _add_command(commands, common, "reconstruct", purpose, _RECONSTRUCT, _RECONSTRUCT_FILES)
    _add_surface(mesh)
    mesh.add_argument(
        "--target-triangles", type=int, metavar="N", help="decimate to N triangles, still closed"
    )
    _add_side(mesh).add_argument(
        "--use-normals", action="store_true", help="take the sides from the normals in IN"
    )


def _add_surface(mesh: argparse.ArgumentParser) -> None:
    resolution = mesh.add_mutually_exclusive_group()
    resolution.add_argument(
        "--depth", type=int, metavar="D", help="2**D cells along the longest side (1 to 16)"
    )
    resolution.add_argument(
        "--voxel-size", type=float, metavar="L", help="side of a cell, in the unit of IN"
    )
    mesh.add_argument(
        "--closed",
        choices=("auto", "yes", "no"),
        default="auto",
        help="auto (default): closed where the points say it is a solid, else open",
    )
    mesh.add_argument(
        "--trim",
        type=_number_or_auto,
        metavar="T",
        help="cut away what has a confidence (0 to 1) below T; auto: the same as --closed auto",
    )
    mesh.add_argument(
        "--precision",
        type=float,
        metavar="E",
        help="largest distance of the local surfaces from the points, in the unit of IN",
    )


def _add_large(commands: Any) -> None:
    """Add the commands for what is more than one file of points."""
    for name, purpose, module in (
        ("tiles", "the same as reconstruct for clouds of any size, tile by tile", tiles),
        ("watch", "mesh the files that a scanner drops into a folder, after each of them", online),
    ):
        parser = commands.add_parser(
            name,
            help=purpose,
            description=module.TEXT,
            epilog=_EXIT_CODES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_options(parser)
        _add_surface(parser)
        if module is online:
            _add_side(parser)
        _add_fits(parser)
        _add_progress(parser)


def _add_compare(commands: Any) -> None:
    compare = commands.add_parser(
        "compare",
        help="compare with Open3D's and MeshLab's reconstructions",
        description=comparison.TEXT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    compare.add_argument("input", type=Path, nargs="+", metavar="IN", help="scans, closed meshes")
    comparison.add_options(compare)
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
        "--no-viewpoint",
        action="store_true",
        help="do not use the scanner's position in the file (PCD VIEWPOINT, PTX, E57)",
    )
    side.add_argument(
        "--towards",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="the same for a scanner far away: a direction that everything faces, 0 0 1 for up",
    )
    return side


def _number_or_auto(text: str) -> float | str:
    try:
        return text if text == "auto" else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"expected a number from 0 to 1 or auto, got {text!r}"
        ) from None


def _offset(text: str) -> tuple[float, ...] | str:
    if text == "auto":
        return text
    try:
        numbers = tuple(float(each) for each in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 3 or not all(math.isfinite(each) for each in numbers):
        raise argparse.ArgumentTypeError(f"expected X,Y,Z or auto, got {text!r}")
    return numbers


def _add_progress(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--progress",
        choices=("auto", "bar", "plain", "none"),
        default="auto",
        help="auto (default): a bar on a terminal, by tqdm if it is installed; plain: lines "
        "'PROGRESS percent text'",
    )


def _add_fits(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--max-nn", type=int, metavar="K", help="largest neighbourhood of a local fit, in points"
    )
    parser.add_argument(
        "--radius", type=float, metavar="R", help="the same as a radius, in the unit of IN"
    )
    parser.add_argument(
        "--threads", type=int, default=-1, metavar="N", help="threads; -1 (default): all cores"
    )


def _common_options() -> _Parser:
    common = _Parser(add_help=False)
    common.add_argument(
        "input", nargs="+", metavar="IN", help="point files (ply pcd xyz las ...), folders, or -"
    )
    common.add_argument("output", metavar="OUT", help="the file to write, a folder, or -")
    common.add_argument(
        "--input-format",
        metavar="F",
        help="format of IN (xyz, las ...) whatever its ending says; needed for -",
    )
    common.add_argument(
        "--output-format",
        metavar="F",
        help="format of the files in a folder OUT (default: ply); needed for -",
    )
    _add_fits(common)
    _add_progress(common)
    common.add_argument(
        "--offset",
        type=_offset,
        metavar="X,Y,Z",
        help="subtract this from all coordinates that are written, for formats and programs with "
        "single precision; auto: round numbers near the points",
    )
    common.add_argument(
        "--attributes",
        action="store_true",
        help="write confidence, noise and outlier of each point (of each vertex: confidence, "
        "noise) to OUT: ply npz las laz",
    )
    common.add_argument("--json", metavar="REPORT", help="write a report as JSON; - for the screen")
    return common
