"""Handles smaller than the data can tell are opened: two sheets that touch have no tunnel between.

Where two sheets come nearer to each other than the samples of one of them, the function decides by
chance on which side of both a place lies, and bridges and tunnels appear. A loop that does not
divide the surface and runs around such a handle is cut, and both sides get a lid (Guskov and Wood,
"Topological noise removal", 2001). Pieces stay connected, and what has room for samples stays.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import _kernels
from o3d_sofnn.meshing.relaxation import smooth_closings

REACH = 3.0
"""Radius of a ball that holds the whole of a handle that is opened, over the spacing."""


ROUNDS = 3
"""Times that the handles are looked for: edges found for one may lie at another one."""


RINGS = 2
"""Rings of triangles around a cut that are smoothed."""


Array = NDArray[np.float64]


Triangles = NDArray[np.int32]


def open_handles(
    vertices: Array, triangles: Triangles, spacing: Callable[[Array], Array]
) -> tuple[Array, Triangles, NDArray[np.int64]]:
    """Open the small handles of a closed mesh.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A closed manifold.
    spacing : callable
        (k, 3) places to (k,) distances of neighbouring samples there.

    Returns
    -------
    vertices : (m + c, 3) float64
        Those of the lids at the end; the others stay, but for those beside a cut.
    triangles : (t + d, 3) int32
        A closed manifold of smaller or the same genus.
    source : (m + c,) int64
        The given vertex that each one was, or is near to.
    """
    source = np.arange(len(vertices))
    on_cut = np.zeros(len(vertices), bool)
    for _ in range(ROUNDS):
        if not has_handles(vertices, triangles):
            break
        edges = np.asarray(_kernels.handle_edges(vertices, triangles))
        ends = np.stack([edges, edges + np.where(edges % 3 < 2, 1, -2)])
        reach = REACH * spacing(vertices[triangles.ravel()[ends]].mean(axis=0))
        opened = _kernels.open_handles(vertices, triangles, edges, reach)
        vertices, changed, like, touched = map(np.asarray, opened)
        source, on_cut = source[like], on_cut[like] | (touched > 0)
        if len(changed) == len(triangles):
            break
        triangles = changed
    return _smooth(vertices, triangles, on_cut), triangles, source


def has_handles(vertices: Array, triangles: Triangles) -> bool:
    """Whether a closed mesh has a genus above zero: by its Euler characteristic, V - T / 2."""
    pieces = int(np.asarray(_kernels.label_pieces(triangles, len(vertices))).max(initial=-1)) + 1
    return 2 * len(vertices) - len(triangles) < 4 * pieces


def _smooth(vertices: Array, triangles: Triangles, on_cut: NDArray[np.bool_]) -> Array:
    """Draw the lids back, each to its own side."""
    near = on_cut.copy()
    for _ in range(RINGS):
        near[triangles[near[triangles].any(axis=1)]] = True
    return (
        smooth_closings(vertices, triangles, np.where(near, 0.0, 1.0)) if near.any() else vertices
    )
