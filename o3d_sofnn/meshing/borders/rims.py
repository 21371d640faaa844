"""Rims of open meshes: straight between the samples, and with edges as long as the spacing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import intersecting_pairs, undo_turns, vertex_normals
from o3d_sofnn.geometry.mesh_properties import with_corner_in
from o3d_sofnn.meshing.repair.untangling import untangle
from o3d_sofnn.threads import thread_count

STRAIGHTENINGS = 5
"""Number of times that rim vertices move halfway to the middle of their neighbours on the rim."""


AWAY = 0.5
"""Longest distance that they move, divided by the spacing: the rim stays at the data."""


EDGE = 2.0
"""Longest edge that replaces two edges, divided by the spacing."""


BULGE = 0.2
"""Largest distance of a removed vertex from the new edge, divided by the spacing."""


TURN = 0.7
"""Smallest cosine between the normals of a triangle before and after a step."""


ROUNDS = 16
"""Number of rounds of edge collapses; edges of one round are not near each other."""


ATTEMPTS = 4
"""Number of attempts; each omits the collapses that made triangles intersect in earlier ones."""


Array = NDArray[np.float64]


Triangles = NDArray[np.int32]


Index = NDArray[np.int64]


def tidy(
    vertices: Array,
    triangles: Triangles,
    spacing: Array,
    fixed: NDArray[np.bool_] | None = None,
) -> tuple[Array, Triangles, Index]:
    """Straighten the rims of a mesh, and join their short edges.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A manifold with rims, without intersecting triangles.
    spacing : (m,) float64
        Spacing of the samples at the vertices.
    fixed : (m,) bool, optional
        Vertices that neither move nor vanish.

    Returns
    -------
    vertices : (v, 3) float64
    triangles : (k, 3) int32
        A mesh of the same kind, with the same connected components, holes and handles.
    used : (v,) int64
        Index of each vertex in the input.
    """
    fixed = np.zeros(len(vertices), bool) if fixed is None else fixed
    straight = straightened(vertices, triangles, spacing, fixed)
    straight = untangle([vertices, straight], triangles)
    triangles = _joined(straight, triangles, spacing, fixed)
    used, number = np.unique(triangles, return_inverse=True)
    return straight[used], number.reshape(-1, 3).astype(np.int32), used.astype(np.int64)


def straightened(
    vertices: Array, triangles: Triangles, spacing: Array, fixed: NDArray[np.bool_] | None = None
) -> Array:
    """Move the vertices of rims along the surface to straighten the rims.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A manifold with rims.
    spacing : (m,) float64
        Spacing of the samples at the vertices.
    fixed : (m,) bool, optional
        Vertices that do not move.

    Returns
    -------
    (m, 3) float64
        New positions, such that no triangle flips.
    """
    before, after = _neighbors(triangles, len(vertices))
    rim = np.flatnonzero(before >= 0 if fixed is None else (before >= 0) & ~fixed)
    if not len(rim):
        return vertices
    normals = np.asarray(vertex_normals(vertices, triangles))[rim]
    moved = vertices.copy()
    for _ in range(STRAIGHTENINGS):
        middle = 0.5 * (moved[before[rim]] + moved[after[rim]])
        way = moved[rim] + 0.5 * (middle - moved[rim]) - vertices[rim]
        way -= np.einsum("rd,rd->r", way, normals)[:, None] * normals
        length = np.maximum(np.linalg.norm(way, axis=1), 1e-300)
        way *= np.minimum(1.0, AWAY * spacing[rim] / length)[:, None]
        moved[rim] = vertices[rim] + way
    return np.asarray(undo_turns(vertices, moved, triangles, TURN))


def _neighbors(triangles: Triangles, n: int) -> tuple[Index, Index]:
    """Return the vertices before and after each rim vertex, (n,); -1 inside or where rims meet."""
    start = triangles.astype(np.int64).ravel()
    end = triangles[:, [1, 2, 0]].astype(np.int64).ravel()
    keys = np.minimum(start, end) * n + np.maximum(start, end)
    order = np.argsort(keys, kind="stable")
    first = _first_of_runs(keys[order])
    border = order[first & np.append(first[1:], True)[: len(first)]]
    start, end = start[border], end[border]
    single = (np.bincount(start, minlength=n) == 1) & (np.bincount(end, minlength=n) == 1)
    before, after = np.full(n, -1), np.full(n, -1)
    after[start], before[end] = end, start
    before[~single], after[~single] = -1, -1
    return before, after


def _first_of_runs(keys: Index) -> NDArray[np.bool_]:
    """Mark the first key of each run of equal keys."""
    first = np.ones(len(keys), bool)
    first[1:] = keys[1:] != keys[:-1]
    return first


def _joined(
    vertices: Array, triangles: Triangles, spacing: Array, fixed: NDArray[np.bool_]
) -> Triangles:
    """Join edges of rims, except at fixed vertices and where triangles would intersect."""
    rim = (_neighbors(triangles, len(vertices))[0] >= 0) & ~fixed
    if not rim.any():
        return triangles
    beside = with_corner_in(rim, triangles)
    inner, kept = triangles[~beside], np.zeros(len(vertices), bool)
    # Vertices along the rims are renumbered, so that the rest of the mesh costs nothing.
    in_band = np.zeros(len(vertices), bool)
    in_band[triangles[beside]] = True
    rows = np.flatnonzero(in_band)
    number = np.cumsum(in_band, dtype=np.int32) - 1
    own, places, apart = number[triangles[beside]], vertices[rows], spacing[rows]
    for _ in range(ATTEMPTS):
        band, free = own, (rim & ~kept)[rows]
        active = free
        for _ in range(ROUNDS):
            target, active = _join(places, band, apart, free, active)
            a, b, c = target[band].T
            fewer = np.stack([a, b, c], axis=1)[(a != b) & (b != c) & (c != a)]
            if len(fewer) == len(band):
                break
            band = fewer
        joined = np.concatenate([inner, rows[band].astype(np.int32)])
        suspect = np.arange(len(joined)) >= len(inner)
        pairs = np.asarray(intersecting_pairs(vertices, joined, suspect, thread_count()))
        if not len(pairs):
            return joined
        kept[joined[pairs.ravel()]] = True
    return triangles


def _join(
    vertices: Array,
    triangles: Triangles,
    spacing: Array,
    free: NDArray[np.bool_],
    active: NDArray[np.bool_],
) -> tuple[Triangles, NDArray[np.bool_]]:
    """Collapse free rim vertices onto a neighbour on the rim, no two close together.

    The triangles are those at rim vertices. Their outer edges may look like rims, but have no free
    vertex. Only the surroundings of active vertices are examined: where nothing has changed since
    the last round, the result would be the same.

    Returns
    -------
    target : (m,) int32
        The vertex that replaces each one.
    active : (m,) bool
        Vertices to examine in the next round.
    """
    near = active.copy()
    for _ in range(2):
        near[triangles[with_corner_in(near, triangles)]] = True
    triangles = triangles[with_corner_in(near, triangles)]
    before, after = _neighbors(triangles, len(vertices))
    candidate = np.flatnonzero(active & free & (before >= 0))
    candidate = candidate[free[before[candidate]] & free[after[candidate]]]
    candidate = candidate[_short(vertices, before, after, candidate, spacing)]
    a, c = before[candidate], after[candidate]
    nearer = np.linalg.norm(vertices[a] - vertices[candidate], axis=1) <= np.linalg.norm(
        vertices[c] - vertices[candidate], axis=1
    )
    onto = np.where(nearer, a, c)
    fine = _keeps_topology(triangles, candidate, onto, len(vertices))
    candidate, onto = candidate[fine], onto[fine]
    fine = _keeps_normals(vertices, triangles, candidate, onto)
    candidate, onto = candidate[fine], onto[fine]
    chosen = _apart(triangles, candidate, vertices, onto)
    target = np.arange(len(vertices), dtype=np.int32)
    target[candidate[chosen]] = onto[chosen]
    again = np.zeros(len(vertices), bool)
    again[candidate[chosen]] = True
    for _ in range(2):  # corners of triangles that change, and whoever looks at these
        again[target[triangles[with_corner_in(again, triangles)]]] = True
    again[candidate[~chosen]] = True
    return target, again


def _short(
    vertices: Array, before: Index, after: Index, candidate: Index, spacing: Array
) -> NDArray[np.bool_]:
    """Mark candidates whose two edges may be replaced by one that is short and close to them."""
    chord = vertices[after[candidate]] - vertices[before[candidate]]
    length = np.linalg.norm(chord, axis=1)
    step = vertices[candidate] - vertices[before[candidate]]
    along = np.einsum("cd,cd->c", step, chord) / np.maximum(length, 1e-300) ** 2
    off = np.linalg.norm(step - np.clip(along, 0.0, 1.0)[:, None] * chord, axis=1)
    own = spacing[candidate]
    return np.asarray((length <= EDGE * own) & (off <= BULGE * own))


def _keeps_topology(
    triangles: Triangles, candidate: Index, onto: Index, n: int
) -> NDArray[np.bool_]:
    """Mark rim edges whose ends have one common neighbour, and more than one triangle.

    Dey, Edelsbrunner, Guha and Nekhayev, "Topology preserving edge contraction", 1999.
    """
    edges = triangles[:, [0, 1, 1, 2, 2, 0, 1, 0, 2, 1, 0, 2]].reshape(-1, 2).astype(np.int64)
    pairs = np.sort(edges[:, 0] * n + edges[:, 1])
    pairs = pairs[_first_of_runs(pairs)]
    first = np.searchsorted(pairs, candidate * n)
    degree = np.searchsorted(pairs, (candidate + 1) * n) - first
    row = np.repeat(np.arange(len(candidate)), degree)
    step = np.arange(len(row)) - np.repeat(np.cumsum(degree) - degree, degree)
    neighbor = pairs[np.repeat(first, degree) + step] % n
    wanted = onto[row] * n + neighbor
    place = np.minimum(np.searchsorted(pairs, wanted), len(pairs) - 1)
    common = np.bincount(row, pairs[place] == wanted, len(candidate))
    number = np.bincount(triangles.ravel(), minlength=n)
    return np.asarray((common == 1) & (number[candidate] > 1))


def _keeps_normals(
    vertices: Array, triangles: Triangles, candidate: Index, onto: Index
) -> NDArray[np.bool_]:
    """Mark candidates whose collapse flips none of the remaining triangles."""
    row = np.full(len(vertices), -1)
    row[candidate] = np.arange(len(candidate))
    fine = np.ones(len(candidate), bool)
    for corner in range(3):
        own = row[triangles[:, corner]]
        rows = np.flatnonzero(own >= 0)
        own, old = own[rows], triangles[rows]
        new = old.copy()
        new[:, corner] = onto[own]
        stays = (old != onto[own][:, None]).all(axis=1)
        was, now = (
            np.cross(vertices[t[:, 1]] - vertices[t[:, 0]], vertices[t[:, 2]] - vertices[t[:, 0]])
            for t in (old, new)
        )
        size = np.linalg.norm(was, axis=1) * np.linalg.norm(now, axis=1)
        turned = np.einsum("td,td->t", was, now) <= TURN * size
        fine[own[stays & turned]] = False
    return fine


def _apart(
    triangles: Triangles, candidate: Index, vertices: Array, onto: Index
) -> NDArray[np.bool_]:
    """Mark candidates with the shortest edge within two rings of triangles."""
    length = np.linalg.norm(vertices[candidate] - vertices[onto], axis=1)
    rank = np.full(len(vertices), len(vertices))
    rank[candidate[np.lexsort((candidate, length))]] = np.arange(len(candidate))
    own = rank[candidate]
    for _ in range(2):
        least = rank[triangles].min(axis=1)
        rank = rank.copy()
        np.minimum.at(rank, triangles.ravel(), np.repeat(least, 3))
    return np.asarray(rank[candidate] == own)
