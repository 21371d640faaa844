"""What stays of the closed surface: pieces that samples lie on and, if wanted, supported parts."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, label_pieces
from o3d_sofnn.geometry.mesh_properties import triangle_areas

SAMPLES = 16
"""Fewest samples on a piece of surface that is kept."""


SUPPORTED = 0.5
"""Confidence along which the automatic choice cuts."""


HOLE = 0.05
"""Largest hole that the automatic choice leaves closed, over the area of the supported surface."""


SMOOTHINGS = 4
"""Averages over neighbours that the confidence goes through before a cut: no teeth."""


SNAP = 0.1
"""Least distance of a border vertex from the ends of its edge, over its length: no slivers."""


Array = NDArray[np.float64]


Triangles = NDArray[np.int32]


def drop_strays(
    vertices: Array, triangles: Triangles, samples: Array, n_threads: int
) -> tuple[Triangles, NDArray[np.int64]]:
    """Drop pieces that hardly any sample lies on.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A mesh of one or more pieces.
    samples : (n, 3) float64
        Points moved onto the surface.
    n_threads : int
        Threads.

    Returns
    -------
    triangles : (k, 3) int32
        What stays, numbered anew.
    used : (v,) int64
        Vertices that stay.
    """
    label = np.asarray(label_pieces(triangles, len(vertices)))
    if not label.any():
        return _compact(triangles, len(vertices))
    nearest = KdTree(vertices, n_threads).query(samples, 1, np.inf, n_threads)[1][:, 0]
    count = np.bincount(label[nearest], minlength=int(label.max(initial=0)) + 1)
    return _compact(
        triangles[(count >= min(SAMPLES, int(count.max())))[label[triangles[:, 0]]]], len(vertices)
    )


def cut(
    vertices: Array, triangles: Triangles, confidence: Array, trim: float | Literal["auto"]
) -> tuple[Array, Triangles, Array]:
    """Cut a mesh along a line of equal confidence.

    Every triangle across the line is divided, so the border is a smooth curve; the mesh stays
    manifold.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
        A closed mesh.
    confidence : (m,) float64
        Support at the vertices, 0 to 1.
    trim : float or "auto"
        Confidence along which to cut. "auto" cuts at 0.5 but leaves holes closed whose area is at
        most 5 % of that of the supported surface: a sheet or a scene opens, an object with gaps
        stays closed.

    Returns
    -------
    vertices, triangles, confidence
        What stays, with new vertices along the border.
    """
    level = SUPPORTED if trim == "auto" else float(trim)
    smooth = _smoothed(confidence, triangles)
    if trim == "auto":
        smooth[_small_holes(vertices, triangles, smooth < level)] = 1.0
    keep = smooth >= level
    number = keep[triangles].sum(axis=1)
    # Turn each crossed triangle so that the corner that is alone on its side comes first.
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
    t = (level - smooth[start]) / (smooth[end] - smooth[start])
    t = np.clip(t, SNAP, 1.0 - SNAP)[:, None]
    vertices = np.concatenate([vertices, vertices[start] + t * (vertices[end] - vertices[start])])
    confidence = np.concatenate([confidence, np.full(len(edges), level)])
    triangles, used = _compact(triangles, len(vertices))
    return vertices[used], triangles, confidence[used]


def _edge_keys(a: NDArray[np.int64], b: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    return np.asarray(np.minimum(a, b) * n + np.maximum(a, b))


def _compact(triangles: Triangles, n: int) -> tuple[Triangles, NDArray[np.int64]]:
    """Leave out the vertices that no triangle uses."""
    is_used = np.zeros(n, bool)
    is_used[triangles] = True
    number = np.cumsum(is_used, dtype=np.int32) - 1
    return number[triangles], np.flatnonzero(is_used)


def _smoothed(values: Array, triangles: Triangles) -> Array:
    """Average with the neighbours, a few times."""
    ends = triangles.ravel()
    count = 2.0 * np.bincount(ends, minlength=len(values))
    for _ in range(SMOOTHINGS):
        at = values[triangles]
        beside = (at.sum(axis=1)[:, None] - at).ravel()
        mean = np.bincount(ends, beside, len(values)) / np.maximum(count, 1.0)
        values = 0.5 * (values + mean)
    return values


def _small_holes(
    vertices: Array, triangles: Triangles, open_: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Vertices of unsupported patches that are small beside the supported surface."""
    area = triangle_areas(vertices, triangles)
    of_vertex = np.bincount(triangles.ravel(), np.repeat(area / 3.0, 3), len(vertices))
    inner = np.ascontiguousarray(triangles[open_[triangles].all(axis=1)])
    label = np.asarray(label_pieces(inner, len(vertices)))
    patch = np.bincount(label, of_vertex)
    return np.asarray(open_ & (patch <= HOLE * of_vertex[~open_].sum())[label])
