"""Loops over the triangles of a mesh: twins of ``native/meshing/mesh.hpp``."""

from __future__ import annotations

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from o3d_sofnn.geometry.mesh_properties import area_vectors
from o3d_sofnn.geometry.vectors import unit

Array = NDArray[np.float64]
Triangles = NDArray[np.int32]


def vertex_normals(vertices: Array, triangles: Triangles) -> Array:
    """Average the normals of the triangles by their area; z where a vertex has none, (m, 3)."""
    facing = area_vectors(vertices, triangles)
    total = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(total, triangles[:, corner], facing)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 0, total / np.maximum(length, 1e-300), [0.0, 0.0, 1.0])


def surroundings(vertices: Array, triangles: Triangles) -> tuple[Array, Array, Array]:
    """Look at the neighbours of every vertex of a closed mesh.

    Returns
    -------
    normals : (m, 3) float64
        Of the vertices.
    ways : (m, 3) float64
        From each vertex to the middle of its neighbours, within its tangent plane.
    lengths : (m,) float64
        Mean over its edges.
    """
    normals = vertex_normals(vertices, triangles)
    # Each edge is met once in each direction, so the followers of a vertex are its neighbours.
    ends, following = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    count = np.maximum(np.bincount(ends, minlength=len(vertices)), 1)
    edges = vertices[following] - vertices[ends]
    ways = np.stack([np.bincount(ends, e, len(vertices)) for e in edges.T], axis=1) / count[:, None]
    ways -= (ways * normals).sum(axis=1, keepdims=True) * normals
    lengths = np.bincount(ends, np.linalg.norm(edges, axis=1), len(vertices)) / count
    return normals, ways, lengths


def bent_vertices(
    vertices: Array, triangles: Triangles, normals: Array, least: float
) -> NDArray[np.uint8]:
    """Whether (1 or 0) the normal of a triangle is below a least cosine to that of a vertex."""
    facing = unit(area_vectors(vertices, triangles))
    bent = np.einsum("td,tkd->tk", facing, normals[triangles]) < least
    result = np.zeros(len(vertices), np.uint8)
    result[triangles[bent]] = 1
    return result


def undo_turns(before: Array, after: Array, triangles: Triangles, cosine: float) -> Array:
    """Take back the moves of vertices whose triangles would turn by more than a cosine.

    Returns
    -------
    (m, 3) float64
        `after`, with rows of `before` where a triangle turns, until none does.
    """
    moved = after.copy()
    facing = unit(area_vectors(before, triangles))
    while True:
        turned = (facing * unit(area_vectors(moved, triangles))).sum(axis=1) < cosine
        turned &= (moved[triangles] != before[triangles]).any(axis=(1, 2))
        if not turned.any():
            return moved
        stay = triangles[turned].ravel()
        moved[stay] = before[stay]


def label_pieces(triangles: Triangles, n_vertices: int) -> NDArray[np.int64]:
    """Label the connected pieces of vertices (m,), in the order of their first ones."""
    edges = np.concatenate([triangles[:, :2], triangles[:, 1:]])
    shape = (n_vertices, n_vertices)
    graph = scipy.sparse.coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=shape)
    label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    _, first, back = np.unique(label, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[back])
