"""Handles smaller than the data can tell are opened: two sheets that touch have no tunnel between.

Where two sheets come nearer to each other than the samples of one of them, the function decides by
chance on which side of both a place lies, and bridges and tunnels appear. A loop that does not
divide the surface and runs around such a handle is cut, and both sides get a lid (Guskov and Wood,
"Topological noise removal", 2001). Pieces stay connected, and what has room for samples stays.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from . import _kernels
from .relaxation import smooth_closings

REACH = 3.0
"""Radius of a ball that holds the whole of a handle that is opened, over the spacing."""
ROUNDS = 8
"""Times that the handles are looked for: one beside another one waits."""
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
    triangles = triangles.copy()
    source = np.arange(len(vertices))
    cuts = []
    for _ in range(ROUNDS):
        if not has_handles(vertices, triangles):
            break
        edges = np.asarray(_kernels.handle_edges(vertices, triangles))
        places = vertices[edges].mean(axis=1)
        loops = _small_loops(vertices, triangles, edges, places, REACH * spacing(places))
        if not loops:
            break
        added, origin, lids = [vertices], [source], [triangles]
        for loop, rows in loops:
            first = sum(map(len, added))
            lids.append(cut_along(triangles, loop, rows, first))
            middles = lids[-1].max() + 1 - first - len(loop)
            added += [vertices[loop], np.tile(vertices[loop].mean(axis=0), (middles, 1))]
            origin += [source[loop], source[loop[:middles]]]
            cuts += [loop, np.arange(first, lids[-1].max() + 1)]
        vertices, triangles = np.concatenate(added), np.concatenate(lids)
        source = np.concatenate(origin)
    if cuts:
        vertices = _smooth(vertices, triangles, np.concatenate(cuts))
    return vertices, triangles, source


def has_handles(vertices: Array, triangles: Triangles) -> bool:
    """Whether a closed mesh has a genus above zero: by its Euler characteristic, V - T / 2."""
    pieces = int(np.asarray(_kernels.label_pieces(triangles, len(vertices))).max(initial=-1)) + 1
    return 2 * len(vertices) - len(triangles) < 4 * pieces


def _small_loops(
    vertices: Array, triangles: Triangles, edges: Triangles, places: Array, reach: Array
) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Loops around the handles that lie in a ball around the edges, and the triangles at them."""
    middle = vertices[triangles].mean(axis=1)
    order = np.argsort(middle[:, 0], kind="stable")
    sorted_x = middle[order, 0]
    first = np.searchsorted(sorted_x, places[:, 0] - reach)
    last = np.searchsorted(sorted_x, places[:, 0] + reach)
    corners = np.arange(triangles.size)
    at = scipy.sparse.csr_matrix((corners, (triangles.ravel(), corners // 3)))
    taken = np.zeros(len(vertices), bool)
    loops = []
    for k, (one, other) in enumerate(edges.tolist()):
        slab = order[first[k] : last[k]]
        inside = ((middle[slab] - places[k]) ** 2).sum(axis=1) < reach[k] ** 2
        patch = np.ascontiguousarray(triangles[np.sort(slab[inside])])
        loop = np.asarray(_kernels.short_loop(vertices, patch, one, other)).astype(np.int64)
        if not len(loop):
            continue
        rows = np.unique(at[loop].indices).astype(np.int64)
        # A loop in the patch of another one could go around the same handle, and both divide.
        if not taken[triangles[rows]].any():
            taken[triangles[rows]] = taken[patch] = True
            loops.append((loop, rows))
    return loops


def cut_along(
    triangles: Triangles, loop: NDArray[np.int64], rows: NDArray[np.int64], first: int
) -> Triangles:
    """Cut a closed mesh along a loop: both sides get a lid.

    Parameters
    ----------
    triangles : (t, 3) int32
        Those on the left of the loop get new vertices, in this array.
    loop : (k,) int64
        Neighbouring vertices, each once; not those of a triangle of the mesh.
    rows : (r,) int64
        Triangles that have a vertex on the loop.
    first : int
        Number of the first new vertex. There are ``k`` on the left of the loop and, where
        ``k > 3``, one in the middle of the lid on the left and one on the right.

    Returns
    -------
    (d, 3) int32
        Triangles of the lids.
    """
    beyond = {
        (triangle[k], triangle[k - 2]): (row, k, triangle[k - 1])
        for row, triangle in zip(rows.tolist(), triangles[rows].tolist(), strict=True)
        for k in range(3)
    }
    names = loop.tolist()
    for k, vertex in enumerate(names):
        end, behind = names[(k + 1) % len(names)], names[k - 1]
        while end != behind:  # around the vertex on the left
            row, place, end = beyond[vertex, end]
            triangles[row, place] = first + k
    left = first + np.arange(len(loop))
    if len(loop) == 3:
        return np.stack([left[::-1], loop]).astype(np.int32)
    middle = np.full(len(loop), first + len(loop))
    lids = np.stack([[middle, np.roll(left, -1), left], [middle + 1, loop, np.roll(loop, -1)]])
    return np.ascontiguousarray(lids.transpose(0, 2, 1).reshape(-1, 3), dtype=np.int32)


def _smooth(vertices: Array, triangles: Triangles, new: NDArray[np.int64]) -> Array:
    """Draw the lids back, each to its own side."""
    near = np.zeros(len(vertices), bool)
    near[new] = True
    for _ in range(RINGS):
        near[triangles[near[triangles].any(axis=1)]] = True
    return smooth_closings(vertices, triangles, np.where(near, 0.0, 1.0))
