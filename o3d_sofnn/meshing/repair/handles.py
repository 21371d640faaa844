"""Removal of handles below the resolution of the data, such as tunnels between touching sheets.

Where two sheets are closer together than their samples, the sign of the function between them is
random, and bridges and tunnels appear. A loop that does not divide the surface and runs around such
a handle is cut, and both sides get a lid (Guskov and Wood, "Topological noise removal", 2001).
Components stay connected, and handles large enough for samples are kept.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, handle_edges, intersecting_pairs, label_pieces
from o3d_sofnn._kernels import open_handles as native_open_handles
from o3d_sofnn.geometry.mesh_properties import with_corner_in
from o3d_sofnn.meshing.repair.relaxation import smooth_closings
from o3d_sofnn.threads import thread_count

REACH = 3.0
"""Radius of a ball that contains a removed handle, divided by the spacing."""


LARGEST = 4096
"""Triangles of a patch at most; such a ball holds some 300 (99 in 100 at most 4000). Beside an
isolated sample far from all others it would hold much of the mesh, with all of its handles."""


ROUNDS = 3
"""Number of searches for handles: edges found for one handle may belong to another."""


RINGS = 2
"""Number of rings of triangles around a cut that are smoothed."""


SMOOTHINGS = 8
"""Number of times that intersecting triangles are smoothed, each time with one more ring."""


ATTEMPTS = 4
"""Number of attempts, each without the handles whose lids still intersected other triangles. In a
tree of thin branches (430 / 2 handles), 20 of 178 removable handles are left."""


Array = NDArray[np.float64]


Triangles = NDArray[np.int32]


def open_handles(
    vertices: Array,
    triangles: Triangles,
    spacing: Callable[[Array], Array],
    left: Array | None = None,
) -> tuple[Array, Triangles, NDArray[np.int64]]:
    """Remove small handles of a closed mesh, unless their lids would intersect other triangles.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A closed manifold without intersecting triangles.
    spacing : callable
        Maps (k, 3) queries to the (k,) distances between neighbouring samples there.
    left : (s, 3) float64, optional
        Places around which handles are left as they are.

    Returns
    -------
    vertices : (m + c, 3) float64
        Vertices; those of the lids come last. Others do not move, except beside a cut.
    triangles : (t + d, 3) int32
        A mesh of the same kind, with a smaller or the same genus.
    source : (m + c,) int64
        For each vertex, the same or a nearby vertex of the input.
    """
    left = np.zeros((0, 3)) if left is None else left
    for _ in range(ATTEMPTS):
        opened, changed, source, on_cut, seeds = _cut(vertices, triangles, spacing, left)
        if not on_cut.any():
            break
        opened, crossing = _draw_back(opened, changed, on_cut)
        if not len(crossing):
            return opened, changed, source
        left = np.concatenate([left, seeds[_nearest(seeds, crossing)[1]]])
    return vertices, triangles, np.arange(len(vertices))


def _cut(
    vertices: Array, triangles: Triangles, spacing: Callable[[Array], Array], left: Array
) -> tuple[Array, Triangles, NDArray[np.int64], NDArray[np.bool_], Array]:
    """Cut the handles except at given places; also return vertices on cuts, and their origins."""
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
            free = _nearest(left, middles)[0] > reach
            edges, middles, reach = edges[free], middles[free], reach[free]
        opened = native_open_handles(vertices, triangles, edges, reach, LARGEST)
        vertices, changed, like, touched = map(np.asarray, opened)
        source, on_cut = source[like], on_cut[like] | (touched > 0)
        seeds.append(middles)
        if len(changed) == len(triangles):
            break
        triangles = changed
    return vertices, triangles, source, on_cut, np.concatenate(seeds)


def _nearest(points: Array, x: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return the distances and indices of the points nearest to queries."""
    distance, number = KdTree(points, thread_count()).query(x, 1, np.inf)
    return distance[:, 0], number[:, 0]


def has_handles(vertices: Array, triangles: Triangles) -> bool:
    """Return whether a closed mesh has a genus above zero (Euler characteristic V - T / 2)."""
    pieces = int(np.asarray(label_pieces(triangles, len(vertices))).max(initial=-1)) + 1
    return 2 * len(vertices) - len(triangles) < 4 * pieces


def _draw_back(
    vertices: Array, triangles: Triangles, on_cut: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Pull each lid back to its own side; also return corners of triangles that still intersect."""
    near, rings = on_cut.copy(), RINGS
    for _ in range(SMOOTHINGS):
        for _ in range(rings):
            near[triangles[with_corner_in(near, triangles)]] = True
        vertices = smooth_closings(vertices, triangles, np.where(near, 0.0, 1.0))
        moved = with_corner_in(near, triangles)
        pairs = np.asarray(intersecting_pairs(vertices, triangles, moved, thread_count()))
        crossing = triangles[pairs.ravel()].ravel()
        if not len(crossing):
            break
        near, rings = np.zeros(len(vertices), bool), rings + 1
        near[crossing] = True
    return vertices, vertices[crossing]
