"""``o3d-sofnn tiles``: its options, and what it does."""

from __future__ import annotations

import argparse
from typing import Any

from o3d_sofnn.progress import ProgressCallback

TEXT = """\
Write one mesh through the points of all IN to DIR/mesh.ply, tile by tile: for clouds larger than
the memory. Neighbouring tiles share the vertices of their seams. What is finished stays in
DIR/work: the same command goes on after an interruption.
IN: las laz (also COPC) ply pcd e57, folders, wildcards in quotes; they may overlap. LAS, LAZ, COPC
and binary PLY are read in parts."""


PASSED = (
    *("points_per_tile", "workers", "scheduler", "normals", "format", "depth", "voxel_size"),
    *("viewpoint", "towards", "trim", "precision", "max_nn", "radius"),
)
"""Options that are called the same in Python."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command that others do not have."""
    parser.add_argument("input", nargs="+", metavar="IN", help="point files of one cloud")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder for the results")
    parser.add_argument(
        "--points-per-tile",
        type=int,
        default=2_000_000,
        metavar="N",
        help="largest number of points of a tile (default: 2000000, about 2 GB a worker)",
    )
    engine = parser.add_mutually_exclusive_group()
    engine.add_argument(
        "--workers", type=int, metavar="N", help="processes on this machine (default: this one)"
    )
    engine.add_argument(
        "--scheduler", metavar="ADDRESS", help="a Dask scheduler, such as tcp://host:8786"
    )
    side = parser.add_mutually_exclusive_group()
    place: dict[str, Any] = {"nargs": 3, "type": float, "metavar": ("X", "Y", "Z")}
    side.add_argument("--viewpoint", **place, help="the scanner's position: everything faces it")
    side.add_argument("--towards", **place, help="a direction that everything faces, 0 0 1 for up")
    parser.add_argument(
        "--normals", action="store_true", help="also write the points with normals: DIR/normals"
    )
    parser.add_argument(
        "--format", choices=("ply", "glb"), help="also write one mesh a tile: DIR/tiles"
    )
    parser.add_argument(
        "--json", metavar="REPORT", help="write the report to another file too; - for the screen"
    )


def run(args: argparse.Namespace, progress: ProgressCallback) -> int:
    """Run the command; return the exit code."""
    from o3d_sofnn.cli import commands
    from o3d_sofnn.operators.common import unwarned
    from o3d_sofnn.operators.tiles import reconstruct_tiles

    options: dict[str, Any] = {name: getattr(args, name) for name in PASSED}
    with unwarned():
        found = reconstruct_tiles(
            args.input,
            args.out,
            closed=commands.closed_of(args),
            n_threads=args.threads,
            print_progress=progress,
            **options,
        )
    commands.write_report(found.figures, args.json)
    return 0
