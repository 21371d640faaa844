"""Stage 2: clouds through which no single surface passes, or whose surface is a guess."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree

FEW = 24
"""Number of points below which a surface is a guess: the corners of a cube or an icosahedron could
belong to many surfaces."""


PLACES = 200
"""Number of points at which the dimension is measured; more would change the share by a few
hundredths."""


COUNTS = (16, 64, 256, 1024)
"""Numbers of neighbours whose distances are compared. A single scale would mistake noise (if
narrow) or a sponge (if wide) for a volume."""


LOCAL = 8
"""Smallest ratio of all points to neighbours: wider neighbourhoods are cut off at the borders."""


SOLID = 2.4
"""Dimension above which a neighbourhood is part of a volume: a surface has 2, a volume has 3, and
2.5 near its border or on a lattice."""


FILLED = 0.3
"""Share of such points above which there is a warning. Filled balls, cubes, cylinders and voxel
masks have 0.5 to 0.9, real scans at most 0.06, and a sphere with noise of a tenth of its radius
0.3."""


def volume_share(points: NDArray[np.float64], tree: KdTree) -> float:
    """Measure the share of points whose neighbours fill a volume.

    On a surface, four times as many neighbours reach twice as far; in a volume, only 1.6 times as
    far. This is the correlation dimension (Grassberger and Procaccia 1983), at every scale.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points.
    tree : KdTree
        Tree of these points.

    Returns
    -------
    float
        Share from 0 to 1; zero for fewer than 512 points, which are too few to decide.
    """
    counts = [count for count in COUNTS if count <= len(points) // LOCAL]
    if len(counts) < 2:
        return 0.0
    rows = np.linspace(0, len(points) - 1, PLACES).astype(int)
    reach = tree.query(points[rows], counts[-1] + 1, np.inf)[0][:, counts]
    growth = np.log(reach[:, 1:] / reach[:, :-1])
    dimension = np.log(COUNTS[1] / COUNTS[0]) / np.maximum(growth, 1e-9)
    return float((dimension.min(axis=1) > SOLID).mean())


def unsuitable(points: NDArray[np.float64], tree: KdTree) -> tuple[str, ...]:
    """Say why a surface through these points is doubtful, and what to do; nothing if it is not.

    The parameters are those of :func:`volume_share`.
    """
    if len(points) < FEW:
        return (
            f"there are only {len(points)} points: the surface between so few is a guess; sample "
            "the object more densely",
        )
    share = volume_share(points, tree)
    if share > FILLED:
        return (
            f"around {100.0 * share:.0f} % of the points the others fill a volume (a voxel mask, a "
            "carved block, or noise as large as the object): there is no single surface through "
            "them. Keep the points at the border of the volume, or extract the surface of the "
            "mask with marching cubes",
        )
    return ()
