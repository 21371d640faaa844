"""Write every scene with true normals as ``NAME.xyz``: ``python -m scenes --out FOLDER``."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path

import numpy as np

from scenes.sensors import Sensor
from scenes.worlds import SCENES, make


def main() -> int:
    """Write the files and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m scenes", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("scenes"), metavar="FOLDER")
    parser.add_argument("-n", type=int, default=20_000, help="rays a scene")
    errors = [field.name for field in dataclasses.fields(Sensor)]
    for name in errors:
        parser.add_argument(f"--{name}", type=float, default=0.0)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    sensor = Sensor(**{name: getattr(args, name) for name in errors})
    for name in SCENES:
        scan = make(name, args.n, sensor)
        file = args.out / f"{name.replace(', ', '_').replace(' ', '_')}.xyz"
        np.savetxt(file, np.hstack([scan.points, scan.normals]), fmt="%.6f")
        print(f"{file}: {len(scan.points)} points, {100.0 * scan.stray.mean():.1f} % mixed pixels")
    return 0


if __name__ == "__main__":
    sys.exit(main())
