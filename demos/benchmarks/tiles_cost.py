"""What a run over tiles costs, up to ten thousand million points: counted, not run.

The plan is the real one, made from the counts of a made survey; bytes and seconds per point are
those measured on small runs (--bytes, --seconds).
"""

from __future__ import annotations

import argparse

import numpy as np

from o3d_sofnn.tiles.dipoles import FEW
from o3d_sofnn.tiles.lattice import GATHERED, MARGIN
from o3d_sofnn.tiles.plan import DEPTH, RIM, Counts, plan
from o3d_sofnn.tiles.sides import MOST
from o3d_sofnn.tiles.work.memory import needed

USUAL = 8
"""Finest cells along the edge of a usual cube."""


CUBE = 1.2
"""Edge of a usual cube, divided by the spacing."""


DIPOLES = 1.4 / (64 / USUAL) ** 2
"""Dipoles for each usual cube of surface: cells of 64 finest cells, and those of coarser levels."""


DIPOLE = 8 * 3 + 8 + 1 + 8 * 3 + 8 + 8 * 3
"""Bytes of one dipole."""


SEAM, FIGURES = 3.0, 500 * 4 * 8
"""Vertices on a seam for each usual cube along it, in an uneven surface; bytes of the figures."""


def survey(points: int) -> Counts:
    """Count the points of a flat survey as wide as long, in the cells of the run."""
    side = 1 << DEPTH
    index = np.stack(np.meshgrid(np.arange(side), np.arange(side), indexing="ij"), axis=-1)
    cells = np.concatenate([index.reshape(-1, 2), np.zeros((side * side, 1), int)], axis=1)
    count = np.full(len(cells), points // len(cells), np.int64)
    count[: points % len(cells)] += 1
    filled = count > 0
    return Counts(np.zeros(3), 1.0, cells[filled].astype(np.int64), count[filled])


def row(points: int, per_tile: int, workers: int, bytes_of: float, seconds: float) -> list[str]:
    """Return the figures of a run of so many points."""
    tiles = [tile for tile in plan(survey(points), per_tile) if tile.count]
    count = max(tile.count for tile in tiles)
    edge = np.sqrt(count)
    around = (edge + 2.0 * RIM) ** 2
    reach = GATHERED / USUAL * CUBE
    gathered = (edge + 2.0 * reach) ** 2
    cubes = count / CUBE**2
    # All levels of the tile and of a rim of its neighbours, and the coarse ones of all others.
    near = DIPOLES * cubes * (1.0 + 4.0 * MARGIN / USUAL * CUBE / edge)
    far = 1.4 * FEW * len(tiles)
    seam = 4.0 * SEAM * edge / CUBE
    told = len(tiles) * FIGURES + 24.0 * min(points, MOST) + len(tiles) * seam * 200.0 / 50.0
    overhead = 0.5 * (around + gathered) / count
    hours = seconds * points * overhead / 3600.0
    return [
        f"{points:.0e}",
        f"{len(tiles)}",
        f"{min(points, MOST)}",
        f"{around * 24 / 1e6:.0f}",
        f"{(gathered - count) * bytes_of / 1e6:.0f}",
        f"{(near + far) * DIPOLE / 1e6:.1f}",
        f"{seam * 130 / 1e6:.1f}",
        f"{needed(int(around)) / 1e9:.1f}",
        f"{told / 1e6:.0f}",
        f"{points * (24 + bytes_of + 150) / 1e9:.0f}",
        f"{hours / workers:.2f}",
    ]


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points-per-tile", type=int, default=2_000_000)
    parser.add_argument("--workers", type=int, default=100)
    parser.add_argument("--bytes", type=float, default=165.0, help="a patch, per point")
    parser.add_argument("--seconds", type=float, default=6e-5, help="of one core, per point")
    args = parser.parse_args()
    print(
        "| points | tiles | points that decide the sides | gather: points, MB | patches, MB "
        "| dipoles, MB | seams, MB | worker, GB | client, MB | work directory, GB "
        f"| hours of {args.workers} workers |\n" + "|---" * 11 + "|"
    )
    for power in range(6, 11):
        figures = row(10**power, args.points_per_tile, args.workers, args.bytes, args.seconds)
        print("| " + " | ".join(figures) + " |")


if __name__ == "__main__":
    main()
