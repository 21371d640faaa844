"""``o3d-sofnn compare``: its options and messages."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from o3d_sofnn.progress import Progress

if TYPE_CHECKING:
    from o3d_sofnn.compare.cases import Source

TEXT = """\
Run this package and its peers (Open3D's and MeshLab's reconstructions) on every IN, and write
DIR/report.html, DIR/results.csv and pictures. A closed mesh is taken as the ground truth: points
are drawn from it, with and without noise, and results are compared with it. Everything else is
treated as a scan.
METHOD is one of ours, open3d_poisson, open3d_ball_pivoting, open3d_alpha_shape, meshlab_poisson,
meshlab_ball_pivoting, meshlab_rimls, meshlab_apss, meshlab_sofnn; MeshLab's methods need:
pip install pymeshlab."""

UP = {"x": ((-0.45, 0.6, 1.0), (1.0, 0.0, 0.0)), "y": ((0.5, 0.4, 1.0), (0.0, 1.0, 0.0))}
UP |= {"z": ((0.6, -1.0, 0.45), (0.0, 0.0, 1.0))}
"""View direction of pictures, and the direction that is up."""
QUICK = {"points": 3_000, "noise": [0.0, 1.0], "sizes": [1_000]}
NOT_QUICK = ("meshlab_apss", "meshlab_sofnn")
"""A method similar to RIMLS, and this package again: left out of a quick comparison."""
FULL: dict[str, Any] = {"points": 20_000, "noise": [0.0, 0.5, 1.0], "sizes": [5_000, 50_000]}


def add_options(parser: argparse.ArgumentParser, output: Path | None = None) -> None:
    """Add the options of the comparison, without the inputs; ``output`` is the default folder."""
    parser.add_argument(
        "--out",
        type=Path,
        required=output is None,
        default=output,
        metavar="DIR",
        help="folder for report, CSV and pictures",
    )
    parser.add_argument(
        "--points",
        type=_count,
        metavar="N",
        help=f"points drawn from a mesh (default: {FULL['points']})",
    )
    parser.add_argument(
        "--noise",
        type=_level,
        nargs="+",
        metavar="P",
        help="noise of these points, in %% of the diagonal (default: 0 0.5 1)",
    )
    parser.add_argument(
        "--sizes",
        type=_count,
        nargs="*",
        metavar="N",
        help="further numbers of points, for time against size (default: 5000 50000)",
    )
    parser.add_argument("--methods", nargs="+", metavar="METHOD", help="run only these methods")
    parser.add_argument(
        "--up", choices=sorted(UP), default="z", help="axis that is up in pictures (default: z)"
    )
    parser.add_argument(
        "--clouds", action="store_true", help="treat closed meshes as scans, too (their vertices)"
    )
    parser.add_argument(
        "--timeout",
        type=_seconds,
        default=180.0,
        metavar="S",
        help="seconds for one method on one cloud (default: %(default)g)",
    )
    parser.add_argument("--quick", action="store_true", help="fewer points, coarser figures")


def run(args: argparse.Namespace, progress: Progress, inputs: Sequence[Source] = ()) -> int:
    """Compare, and print where the report is.

    Parameters
    ----------
    args : argparse.Namespace
        The options of ``add_options``, and ``input``, a list of files.
    progress : Progress
        Called with the fraction done and the current stage.
    inputs : sequence of Source
        Inputs that are used if there are no files.

    Returns
    -------
    int
        Exit code: 0; or 1 if this package failed on a cloud, or an input could not be read.

    Raises
    ------
    ValueError
        A method is unknown.
    KeyboardInterrupt
        After Ctrl-C; the report on the finished part is written.
    """
    from o3d_sofnn.compare import cases
    from o3d_sofnn.compare.evaluate import METHODS
    from o3d_sofnn.compare.raster import View
    from o3d_sofnn.compare.report import failures
    from o3d_sofnn.compare.run import run as compare

    usual = [method for method in METHODS if not args.quick or method not in NOT_QUICK]
    methods = args.methods or usual
    unknown = [method for method in methods if method not in METHODS]
    if unknown:
        raise ValueError(f"--methods: expected some of {' '.join(METHODS)}, got {unknown[0]}")
    chosen = QUICK if args.quick else FULL
    given = {key: value for key in chosen if (value := getattr(args, key)) is not None}
    sources = cases.sources(args.input, View(*UP[args.up]), args.clouds) or list(inputs)
    try:
        result = compare(
            sources,
            args.out,
            methods=methods,
            ladder=cases.Ladder(**{**chosen, **given}),
            timeout=args.timeout,
            quick=args.quick,
            progress=progress,
        )
    except KeyboardInterrupt:
        progress.close()
        sys.stderr.write(f"what was finished is in {args.out.resolve()}\n")
        raise
    progress(1.0, "done")
    progress.close()
    for line in failures(result.rows):
        sys.stderr.write(f"failed: {line}\n")
    sys.stdout.write(f"report {result.report.resolve()}\n")
    return int(any(row["error"] for row in result.rows if row["method"] in ("ours", "")))


def _count(text: str) -> int:
    value = int(text)
    if value < 4:
        raise argparse.ArgumentTypeError(f"expected at least 4, got {value}")
    return value


def _level(text: str) -> float:
    value = float(text)
    if not 0.0 <= value <= 100.0:
        raise argparse.ArgumentTypeError(f"expected 0 to 100, got {text}")
    return value


def _seconds(text: str) -> float:
    value = float(text)
    if not value > 0.0:
        raise argparse.ArgumentTypeError(f"expected a positive number, got {text}")
    return value
