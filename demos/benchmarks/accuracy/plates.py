"""Flipped normals on many copies of one thin plate, side by side: ``python plates.py``.

What is right for one part must be right for a thousand of them. Every plate is 1 x 1 x 0.2 with a
thousand points and a noise of 0.002 unless options say otherwise; sides are absolute.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.pipeline import estimate_normals

Array = NDArray[np.float64]

APART = 1.5
"""Distance between the middles of neighbouring plates."""


def plates(
    count: int, n: int, thickness: float, noise: float, seed: int = 0
) -> tuple[Array, Array]:
    """Draw points and outward normals of plates on a square lattice, each drawn anew."""
    rng = np.random.default_rng(seed)
    size = np.array([1.0, 1.0, thickness])
    area = np.prod(size) / size
    total = count * n
    axis, sign = rng.choice(3, total, p=area / area.sum()), rng.choice([-1.0, 1.0], total)
    row = np.arange(total)
    points, normals = rng.uniform(-0.5, 0.5, (total, 3)), np.zeros((total, 3))
    points[row, axis], normals[row, axis] = 0.5 * sign, sign
    points = points * size + rng.normal(0.0, noise, (total, 3))
    plate, side = row // n, int(np.ceil(np.sqrt(count)))
    points[:, 0] += APART * (plate % side)
    points[:, 1] += APART * (plate // side)
    return points, normals


def main() -> int:
    """Print a line for each number of plates."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--counts", type=int, nargs="+", default=[1, 25, 400], metavar="K")
    parser.add_argument("-n", type=int, default=1000, help="points of each (default: %(default)s)")
    parser.add_argument("--thickness", type=float, default=0.2)
    parser.add_argument("--noise", type=float, default=0.002)
    options = parser.parse_args()
    print("| plates | points | flipped, % | worst plate, % | CPU seconds | warnings |")
    print("|---|---|---|---|---|---|")
    for count in options.counts:
        points, normals = plates(count, options.n, options.thickness, options.noise)
        start = time.process_time()
        found = estimate_normals(points)
        seconds = time.process_time() - start
        wrong = (found.normals * normals).sum(axis=1) <= 0.0
        worst = wrong.reshape(count, -1).mean(axis=1).max()
        print(
            f"| {count} | {len(points)} | {100.0 * wrong.mean():.3f} | {100.0 * worst:.2f} "
            f"| {seconds:.1f} | {len(found.warnings)} |",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
