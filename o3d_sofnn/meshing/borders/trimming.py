"""Removal of components without samples and, on request, of parts without support by the data."""

from __future__ import annotations

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, label_pieces
from o3d_sofnn.geometry.mesh_properties import with_corner_in
from o3d_sofnn.threads import thread_count

SAMPLES = 24
"""Smallest number of samples on a connected component that is kept."""


SMOOTH = 1.5
"""Length, divided by the spacing, along which values are averaged before a cut, so that single
samples do not make teeth. Less leaves teeth, more rounds corners."""


SMOOTHINGS = 30
"""Largest number of averaging steps."""


RINGS = 12
"""Number of rings of triangles around the cut that take part."""


SNAP = 0.1
"""Smallest distance of a border vertex from the ends of its edge, divided by the edge's length, so
that there are no slivers."""


Array = NDArray[np.float64]


Triangles = NDArray[np.int32]


def drop_strays(
    vertices: Array, triangles: Triangles, samples: Array
) -> tuple[Triangles, NDArray[np.int64]]:
    """Remove connected components with hardly any samples.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A mesh of one or more components.
    samples : (n, 3) float64
        Points moved onto the surface.

    Returns
    -------
    triangles : (k, 3) int32
        Remaining triangles, with new vertex indices.
    used : (v,) int64
        Indices of the remaining vertices.
    """
    label = np.asarray(label_pieces(triangles, len(vertices)))
    if not label.any():
        return _compact(triangles, len(vertices))
    nearest = KdTree(vertices, thread_count()).query(samples, 1, np.inf)[1][:, 0]
    count = np.bincount(label[nearest], minlength=int(label.max(initial=0)) + 1)
    return _compact(
        triangles[(count >= min(SAMPLES, int(count.max())))[label[triangles[:, 0]]]], len(vertices)
    )


def cut(
    vertices: Array, triangles: Triangles, confidence: Array, values: Array, level: float
) -> tuple[Array, Triangles, Array, NDArray[np.int64]]:
    """Cut away parts where values at the vertices are below a level.

    Every triangle across the cut is divided, so the border is a smooth curve; the mesh stays
    manifold.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A closed mesh.
    confidence : (m,) float64
        Confidence, interpolated at the new vertices.
    values : (m,) float64
        Values that are compared with the level.
    level : float
        Level at which to cut.

    Returns
    -------
    vertices, triangles, confidence
        The remaining mesh, with new vertices along the border.
    ends : (v, 2) int64
        For each vertex, the ends of the edge that it is on: the lower number first, or twice the
        same if it was there before.
    """
    keep = values >= level
    number = keep[triangles].sum(axis=1)
    # Rotate each crossed triangle so that the corner that is alone on its side comes first.
    alone = np.where(number == 1, 0, 1)[:, None] ^ keep[triangles]
    crossed = np.flatnonzero((number == 1) | (number == 2))
    turned = (np.argmax(alone[crossed], axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles[crossed], turned, axis=1).astype(np.int64).T
    keys = np.stack([_edge_keys(a, b, len(vertices)), _edge_keys(a, c, len(vertices))], axis=1)
    edges, index = np.unique(keys, return_inverse=True)
    ab, ac = (len(vertices) + index.reshape(-1, 2)).T
    one = number[crossed] == 1
    triangles = np.concatenate(
        [
            triangles[number == 3],
            np.stack([a, ab, ac], axis=1)[one],
            np.stack([ab, b, c], axis=1)[~one],
            np.stack([ab, c, ac], axis=1)[~one],
        ]
    ).astype(np.int32)
    start, end = np.divmod(edges, len(vertices))
    t = (level - values[start]) / (values[end] - values[start])
    t = np.clip(t, SNAP, 1.0 - SNAP)
    confidence = np.concatenate([confidence, (1.0 - t) * confidence[start] + t * confidence[end]])
    t = t[:, None]
    vertices = np.concatenate([vertices, vertices[start] + t * (vertices[end] - vertices[start])])
    old = np.arange(len(keep))
    ends = np.concatenate([np.stack([old, old], axis=1), np.stack([start, end], axis=1)])
    triangles, used = _compact(triangles, len(vertices))
    return vertices[used], triangles, confidence[used], ends[used]


def _edge_keys(a: NDArray[np.int64], b: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    return np.asarray(np.minimum(a, b) * n + np.maximum(a, b))


def _compact(triangles: Triangles, n: int) -> tuple[Triangles, NDArray[np.int64]]:
    """Remove the vertices that no triangle uses."""
    is_used = np.zeros(n, bool)
    is_used[triangles] = True
    number = np.cumsum(is_used, dtype=np.int32) - 1
    return number[triangles], np.flatnonzero(is_used)


def smoothed(
    values: Array,
    level: float,
    vertices: Array,
    triangles: Triangles,
    spacing: Array,
    fixed: NDArray[np.bool_] | None = None,
) -> Array:
    """Average values along the surface near the curves where they cross a level.

    Parameters
    ----------
    values : (m,) float64
        Values at the vertices.
    level : float
        Level at which to cut.
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A closed mesh.
    spacing : (m,) float64
        Spacing of the samples at the vertices.
    fixed : (m,) bool, optional
        Vertices that keep their values.

    Returns
    -------
    (m,) float64
    """
    below = values < level
    near = np.zeros(len(values), bool)
    crossed = with_corner_in(below, triangles) & with_corner_in(~below, triangles)
    near[triangles[crossed]] = True
    for _ in range(RINGS):
        near[triangles[with_corner_in(near, triangles)]] = True
    if fixed is not None:
        near &= ~fixed
    rows = np.flatnonzero(near)
    number = np.full(len(values), -1)
    number[rows] = np.arange(len(rows))
    # Each edge occurs once in each direction, so the successors of a vertex are its neighbours.
    own = triangles[with_corner_in(near, triangles)]
    start, end = own.ravel(), own[:, [1, 2, 0]].ravel()
    own = near[start]
    start, end = start[own], end[own]
    count = np.maximum(np.bincount(number[start], minlength=len(rows)), 1)
    length = np.linalg.norm(vertices[start] - vertices[end], axis=1)
    edge = np.maximum(np.bincount(number[start], length, len(rows)) / count, 1e-300)
    mean = scipy.sparse.csr_matrix(
        (1.0 / count[number[start]], (number[start], end)), shape=(len(rows), len(values))
    )
    wanted = 2.0 * (SMOOTH * spacing[rows] / edge) ** 2
    times = int(np.clip(np.ceil(wanted.max(initial=0.0)), 1, SMOOTHINGS))
    share = np.minimum(wanted / times, 0.9)
    result = values.copy()
    for _ in range(times):
        result[rows] += share * (mean @ result - result[rows])
    return result
