"""Pieces, handles and triangles of reconstructed closed meshes: ``python topology.py MESH ...``.

The truth is the mesh that the points are drawn from.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from truth import Case, draw, parser, read_closed

from o3d_sofnn.metrics import component_labels, euler_characteristic
from o3d_sofnn.pipeline import reconstruct_surface


def shape(vertices: NDArray[Any], triangles: NDArray[Any]) -> tuple[int, int]:
    """Return the number of pieces of a closed mesh and the sum of their genera."""
    _, joined = np.unique(vertices, axis=0, return_inverse=True)  # files may repeat vertices
    triangles = joined.reshape(-1)[triangles]
    pieces = component_labels(triangles)[0]
    return pieces, pieces - euler_characteristic(triangles) // 2


def main() -> int:
    """Print a line for each mesh and noise level."""
    options = parser(__doc__, points=100_000).parse_args()
    print("| cloud | pieces | of the truth | genus | of the truth | triangles |")
    print("|---|---|---|---|---|---|")
    for file in options.meshes:
        truth = shape(*read_closed(file))
        for noise in options.noise:
            surface = reconstruct_surface(draw(Case(file, options.n, noise)).points)
            ours = shape(surface.vertices, surface.triangles)
            print(
                f"| {file.stem}, {noise:g} % | {ours[0]} | {truth[0]} | {ours[1]} | {truth[1]} "
                f"| {len(surface.triangles)} |",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
