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

from o3d_sofnn._kernels import KdTree, handle_edges, intersecting_pairs, label_pieces
from o3d_sofnn._kernels import open_handles as native_open_handles
from o3d_sofnn.geometry.mesh_properties import with_corner_in
from o3d_sofnn.meshing.repair.relaxation import smooth_closings

REACH = 3.0
"""Radius of a ball that holds the whole of a handle that is opened, over the spacing."""


LARGEST = 4096
"""Triangles of a patch at most; such a ball holds some 300 (99 in 100 at most 4000). Beside an
isolated sample far from all others it would hold much of the mesh, with all of its handles."""


ROUNDS = 3
"""Times that the handles are looked for: edges found for one may lie at another one."""


RINGS = 2
"""Rings of triangles around a cut that are smoothed."""


SMOOTHINGS = 8
"""Times that what cuts other triangles is smoothed, each time with a ring more around it."""


ATTEMPTS = 4
"""Times that handles are opened, without those whose lids went on cutting other triangles. In a
tree of thin branches (430 / 2 handles) 20 in 178 stay that could be opened."""


Array = NDArray[np.float64]


Triangles = NDArray[np.int32]


def open_handles(
    vertices: Array, triangles: Triangles, spacing: Callable[[Array], Array], n_threads: int = 1
) -> tuple[Array, Triangles, NDArray[np.int64]]:
    """Open the small handles of a closed mesh, but for those whose lids would cut other triangles.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A closed manifold, no triangle of which cuts another one.
    spacing : callable
        (k, 3) places to (k,) distances of neighbouring samples there.
    n_threads : int, default 1
        Number of threads.

    Returns
    -------
    vertices : (m + c, 3) float64
        Those of the lids at the end; the others stay, but for those beside a cut.
    triangles : (t + d, 3) int32
        Of the same kind, with a smaller or the same genus.
    source : (m + c,) int64
        The given vertex that each one was, or is near to.
    """
    left = np.zeros((0, 3))
    for _ in range(ATTEMPTS):
        opened, changed, source, on_cut, seeds = _cut(vertices, triangles, spacing, left)
        if not on_cut.any():
            break
        opened, crossing = _draw_back(opened, changed, on_cut, n_threads)
        if not len(crossing):
            return opened, changed, source
        left = np.concatenate([left, seeds[_nearest(seeds, crossing, n_threads)[1]]])
    return vertices, triangles, np.arange(len(vertices))


def _cut(
    vertices: Array, triangles: Triangles, spacing: Callable[[Array], Array], left: Array
) -> tuple[Array, Triangles, NDArray[np.int64], NDArray[np.bool_], Array]:
    """Open the handles that are not around some places; vertices on cuts, and where it began."""
    source = np.arange(len(vertices))
    on_cut = np.zeros(len(vertices), bool)
    seeds = [np.zeros((0, 3))]
    for _ in range(ROUNDS):
        if not has_handles(vertices, triangles):
            break
        edges = np.asarray(handle_edges(vertices, triangles))
        ends = np.stack([edges, edges + np.where(edges % 3 < 2, 1, -2)])
        middles = vertices[triangles.ravel()[ends]].mean(axis=0)
        reach = REACH * spacing(middles)
        if len(left):
            free = _nearest(left, middles, 1)[0] > reach
            edges, middles, reach = edges[free], middles[free], reach[free]
        opened = native_open_handles(vertices, triangles, edges, reach, LARGEST)
        vertices, changed, like, touched = map(np.asarray, opened)
        source, on_cut = source[like], on_cut[like] | (touched > 0)
        seeds.append(middles)
        if len(changed) == len(triangles):
            break
        triangles = changed
    return vertices, triangles, source, on_cut, np.concatenate(seeds)


def _nearest(points: Array, x: Array, n_threads: int) -> tuple[Array, NDArray[np.int64]]:
    """Distances and numbers of the points nearest to some places."""
    distance, number = KdTree(points, n_threads).query(x, 1, np.inf, n_threads)
    return distance[:, 0], number[:, 0]


def has_handles(vertices: Array, triangles: Triangles) -> bool:
    """Whether a closed mesh has a genus above zero: by its Euler characteristic, V - T / 2."""
    pieces = int(np.asarray(label_pieces(triangles, len(vertices))).max(initial=-1)) + 1
    return 2 * len(vertices) - len(triangles) < 4 * pieces


def _draw_back(
    vertices: Array, triangles: Triangles, on_cut: NDArray[np.bool_], n_threads: int
) -> tuple[Array, Array]:
    """Draw the lids back, each to its own side; corners of triangles that go on cutting others."""
    near, rings = on_cut.copy(), RINGS
    for _ in range(SMOOTHINGS):
        for _ in range(rings):
            near[triangles[with_corner_in(near, triangles)]] = True
        vertices = smooth_closings(vertices, triangles, np.where(near, 0.0, 1.0))
        moved = with_corner_in(near, triangles)
        pairs = np.asarray(intersecting_pairs(vertices, triangles, moved, n_threads))
        crossing = triangles[pairs.ravel()].ravel()
        if not len(crossing):
            break
        near, rings = np.zeros(len(vertices), bool), rings + 1
        near[crossing] = True
    return vertices, vertices[crossing]
