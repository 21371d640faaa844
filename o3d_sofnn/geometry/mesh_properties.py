"""Properties of meshes (closed, manifold ...) and angles between normals: arrays in, numbers out.

Triangles are ``(f, 3)`` arrays of vertex indices, lengths are in the unit of the coordinates.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

Triangles = NDArray[np.integer[Any]]


Points = NDArray[np.floating[Any]]


def boundary_edges(triangles: Triangles) -> NDArray[np.int64]:
    """Return the edges of exactly one triangle, ``(b, 2)`` vertex indices, smaller first."""
    edges, counts = _edges(triangles)
    return np.asarray(edges[counts == 1])


def with_corner_in(marked: NDArray[np.bool_], triangles: Triangles) -> NDArray[np.bool_]:
    """Mark triangles, ``(f,)``, with at least one corner among the marked vertices."""
    # Three gathers: numpy reduces rows of three far more slowly.
    a, b, c = (marked[triangles[:, corner]] for corner in range(3))
    return np.asarray(a | b | c)


def is_closed(triangles: Triangles) -> bool:
    """Return whether there are triangles, and no edge belongs to exactly one."""
    return len(triangles) > 0 and len(boundary_edges(triangles)) == 0


def is_edge_manifold(triangles: Triangles) -> bool:
    """Return whether no edge has more than two triangles, and no triangle repeats a vertex."""
    _, counts = _edges(triangles)
    return not has_repeated_indices(triangles) and bool((counts <= 2).all())


def is_vertex_manifold(triangles: Triangles) -> bool:
    """Return whether the triangles around every vertex are connected by edges at that vertex."""
    if len(triangles) == 0:
        return True
    n_corners = triangles.size
    corners = np.arange(n_corners).reshape(-1, 3)
    # Half-edge k of a triangle goes from corner k to corner k + 1.
    start, stop = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    flat = np.asarray(triangles).ravel()
    swap = flat[start] > flat[stop]
    low, high = np.where(swap, stop, start), np.where(swap, start, stop)
    order = np.lexsort((flat[high], flat[low]))
    low, high = low[order], high[order]
    same = (flat[low][1:] == flat[low][:-1]) & (flat[high][1:] == flat[high][:-1])
    first = np.concatenate([low[:-1][same], high[:-1][same]])
    second = np.concatenate([low[1:][same], high[1:][same]])
    return _count_components(first, second, n_corners)[0] == len(np.unique(flat))


def is_consistently_wound(triangles: Triangles) -> bool:
    """Return whether neighbours run through their common edge in opposite directions."""
    directed = _half_edges(triangles)
    return len(np.unique(directed, axis=0)) == len(directed)


def is_watertight(triangles: Triangles) -> bool:
    """Return whether the mesh is closed, edge-manifold and consistently wound."""
    if len(triangles) == 0 or has_repeated_indices(triangles):
        return False
    # Each half-edge and its opposite occur once. Sorting numbers is many times as fast as rows.
    corners = np.asarray(triangles, dtype=np.int64)
    start, end = corners.ravel(), np.roll(corners, -1, axis=1).ravel()
    n = int(corners.max()) + 1
    there, back = np.sort(start * n + end), np.sort(end * n + start)
    return bool((there[1:] != there[:-1]).all() and (there == back).all())


def has_repeated_indices(triangles: Triangles) -> bool:
    """Return whether a triangle uses a vertex twice."""
    a, b, c = np.asarray(triangles).T
    return bool(((a == b) | (b == c) | (c == a)).any())


def euler_characteristic(triangles: Triangles) -> int:
    """Return V - E + F, counting used vertices only: 2 per sphere, 0 per torus."""
    return len(np.unique(triangles)) - len(_edges(triangles)[0]) + len(triangles)


def component_labels(triangles: Triangles) -> tuple[int, NDArray[np.int64]]:
    """Return the number of components that share no vertex, and the component of every triangle.

    Returns
    -------
    count : int
        Number of connected components.
    labels : numpy.ndarray, shape (f,)
        Component of each triangle, numbered from 0 in order of first appearance.
    """
    if len(triangles) == 0:
        return 0, np.zeros(0, dtype=np.int64)
    vertices, compact = np.unique(triangles, return_inverse=True)
    compact = compact.reshape(-1, 3)
    _, of_vertex = _count_components(
        compact[:, [0, 1]].ravel(), compact[:, [1, 2]].ravel(), len(vertices)
    )
    _, first, labels = np.unique(of_vertex[compact[:, 0]], return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return len(first), rank[labels]


def signed_volume(vertices: Points, triangles: Triangles) -> float:
    """Return the volume that a closed mesh encloses, positive when its normals point outward."""
    # Close to the origin, the products of coordinates do not lose digits by cancellation.
    a, b, c = _corners(vertices - vertices.mean(axis=0), triangles)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


def triangle_areas(vertices: Points, triangles: Triangles) -> NDArray[np.float64]:
    """Return the ``(f,)`` areas, in squared units."""
    return np.asarray(np.linalg.norm(area_vectors(vertices, triangles), axis=1))


def sample_surface(
    vertices: Points, triangles: Triangles, count: int, seed: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw points evenly by area.

    Parameters
    ----------
    vertices : numpy.ndarray, shape (m, 3)
        Coordinates.
    triangles : numpy.ndarray, shape (f, 3)
        Vertex indices.
    count : int
        Number of points.
    seed : int, default 0
        Seed of the random numbers; the same seed gives the same points.

    Returns
    -------
    points, normals : numpy.ndarray, shape (count, 3)
        Points, and the unit normals of their triangles.
    """
    rng = np.random.default_rng(seed)
    normals = area_vectors(vertices, triangles)
    areas = np.linalg.norm(normals, axis=1)
    chosen = rng.choice(len(triangles), count, p=areas / areas.sum())
    # The square root makes the density uniform (Osada et al. 2002, Shape distributions, eq. (1)).
    u, v = np.sqrt(rng.random((count, 1))), rng.random((count, 1))
    a, b, c = _corners(vertices, triangles[chosen])
    points = (1 - u) * a + u * (1 - v) * b + u * v * c
    return points, normals[chosen] / areas[chosen, np.newaxis]


def flipped_fraction(normals: Points, reference: Points) -> float:
    """Return the share of ``normals`` more than a right angle away from ``reference``."""
    return float((np.einsum("ij,ij->i", normals, reference) <= 0).mean())


def normal_angles(normals: Points, reference: Points) -> NDArray[np.float64]:
    """Return the angles in degrees, 0 to 90, between two sets of unit vectors, sign ignored."""
    # The arc cosine of the dot product would lose half of the digits of a small angle.
    sine = np.linalg.norm(np.cross(normals, reference), axis=1)
    cosine = np.abs(np.einsum("ij,ij->i", normals, reference))
    return np.asarray(np.degrees(np.arctan2(sine, cosine)))


def _half_edges(triangles: Triangles) -> NDArray[np.int64]:
    array = np.asarray(triangles, dtype=np.int64)
    return np.concatenate([array[:, [0, 1]], array[:, [1, 2]], array[:, [2, 0]]])


def _edges(triangles: Triangles) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the undirected edges, each once, and how many triangles have them."""
    # One number per edge: sorting these is many times as fast as sorting rows.
    corners = np.asarray(triangles).T
    n = int(corners.max(initial=0)) + 1
    pairs = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    keys = np.concatenate(
        [np.minimum(a, b).astype(np.int64) * n + np.maximum(a, b) for a, b in pairs]
    )
    keys, counts = np.unique(keys, return_counts=True)
    return np.stack(np.divmod(keys, n), axis=1), counts


def _count_components(
    first: NDArray[Any], second: NDArray[Any], count: int
) -> tuple[int, NDArray[Any]]:
    graph = scipy.sparse.coo_matrix(
        (np.ones(len(first), dtype=np.int8), (first, second)), shape=(count, count)
    )
    number, labels = connected_components(graph, directed=False)
    return int(number), labels


def _corners(vertices: Points, triangles: Triangles) -> tuple[Points, Points, Points]:
    return vertices[triangles[:, 0]], vertices[triangles[:, 1]], vertices[triangles[:, 2]]


def area_vectors(vertices: Points, triangles: Triangles) -> NDArray[np.float64]:
    """Return vectors along the triangles' normals, as long as their areas."""
    a, b, c = _corners(vertices, triangles)
    return np.asarray(np.cross(b - a, c - a) / 2.0, dtype=np.float64)
