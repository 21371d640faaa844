"""Sides of scans with no option: ``python sides.py [FILE ...]``.

Made scenes first, clean and with a sensor's errors: how far from its place the nearest scanner was
found, what has decided, and the share of the points on surfaces whose normal faces away from the
side that was seen. Then files: what has decided, and the share of the points that face the origin
and up, of which one is the truth for most scans.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import scenes
from numpy.typing import NDArray

from o3d_sofnn.compare import cases
from o3d_sofnn.orientation.evidence import Evidence
from o3d_sofnn.orientation.visibility import Several, Station
from o3d_sofnn.pipeline import estimate_normals

LASER = scenes.Sensor(noise=0.005, mixed=0.5, dropouts=0.05)
CAMERA = scenes.Sensor(noise=0.0015, growth=2.0, mixed=0.5, dropouts=0.05)
"""Errors of scanners and of depth cameras: 5 mm, and 1.5 mm at one metre."""


def main() -> int:
    """Print both tables and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE")
    parser.add_argument("-n", type=int, default=20_000, help="rays a scene")
    parser.add_argument("--scenes", nargs="+", choices=scenes.SCENES, default=list(scenes.SCENES))
    args = parser.parse_args()
    print("| scene | errors | decided by | off, m | flipped, % |\n|---|---|---|---|---|")
    for name in args.scenes:
        camera = name in ("table", "room, camera")
        for said, sensor in (("none", None), ("yes", CAMERA if camera else LASER)):
            scan = scenes.make(name, args.n, sensor, seed=3)
            found = estimate_normals(scan.points)
            off = distance_off(found.evidence, scan.stations)
            flipped = 100.0 * scan.flipped(found.normals)
            print(
                f"| {name} | {said} | {found.evidence.kind} | {off} | {flipped:.2f} |", flush=True
            )
    if args.files:
        print("\n| file | decided by | face the origin, % | face up, % |\n|---|---|---|---|")
    for file in args.files:
        points = cases.read_points(file)
        found = estimate_normals(points)
        origin = 100.0 * (np.einsum("nd,nd->n", found.normals, points) < 0.0).mean()
        up = 100.0 * (found.normals[:, 2] > 0.0).mean()
        print(f"| {file.name} | {found.evidence.kind} | {origin:.1f} | {up:.1f} |", flush=True)
    return 0


def distance_off(evidence: Evidence, stations: NDArray[np.float64]) -> str:
    """Return the largest distance of a place found from the true one that is nearest, in metres."""
    sight = evidence.sight
    if isinstance(sight, Station) and not sight.far:
        places = sight.place[None]
    elif isinstance(sight, Several):
        places = sight.places
    else:
        return ""
    true = np.unique(stations, axis=0)
    return f"{np.linalg.norm(places[:, None] - true, axis=2).min(axis=1).max():.2f}"


if __name__ == "__main__":
    sys.exit(main())
