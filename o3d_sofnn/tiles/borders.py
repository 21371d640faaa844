"""Where the surface ends, over all tiles: decided once, then cut tile by tile with equal seams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, label_pieces
from o3d_sofnn.geometry.mesh_properties import boundary_edges
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.meshing.borders.closing import EDGE, Closing, described
from o3d_sofnn.meshing.borders.rims import tidy
from o3d_sofnn.meshing.borders.sums import Sums, merged
from o3d_sofnn.meshing.borders.trimming import cut, smoothed
from o3d_sofnn.meshing.mesh import FAR
from o3d_sofnn.options import Options
from o3d_sofnn.threads import thread_count

if TYPE_CHECKING:
    from o3d_sofnn.tiles.mesh import TileMesh

Array = NDArray[np.float64]


Index = NDArray[np.int64]


@dataclass(frozen=True)
class Seam:
    """What neighbours need of the vertices on the seams of a tile.

    Attributes
    ----------
    names : (s, 3) float64
        As in :class:`TileMesh`.
    vertices, normals : (s, 3) float64
        Repaired positions, and normals.
    confidence, beyond, spacing : (s,) float64
    patch, component : (s,) int64
        As in :class:`TileMesh`.
    """

    names: Array
    vertices: Array
    normals: Array
    confidence: Array
    beyond: Array
    spacing: Array
    patch: Index
    component: Index

    @classmethod
    def of(cls, mesh: TileMesh) -> Seam:
        """Return the seam of a tile."""
        s = slice(len(mesh.seam))
        return cls(
            mesh.seam,
            mesh.vertices[s],
            mesh.normals[s],
            mesh.confidence[s],
            mesh.beyond[s],
            mesh.spacing[s],
            mesh.patch[s],
            mesh.component[s],
        )


def shared(one: Seam, other: Seam) -> tuple[Index, Index]:
    """Return the indices of the vertices that two seams share, in each of them."""
    row, at = names_of(one.names), names_of(other.names)
    _, a, b = np.intersect1d(row, at, assume_unique=True, return_indices=True)
    return np.asarray(a, np.int64), np.asarray(b, np.int64)


def names_of(places: Array) -> NDArray[np.void]:
    """Return places, (s, 3), as bytes, (s,)."""
    return np.ascontiguousarray(places + 0.0).view(np.dtype((np.void, 24))).ravel()


def settled(table: Any, keep: NDArray[np.bool_]) -> Any:
    """Return a mesh or seam in which vertices of patches that stay, (p,) bool, are on the data."""
    stays = np.append(keep, False)[table.patch]
    return replace(table, beyond=np.where(stays, 0.0, table.beyond))


def owned(mesh: TileMesh, before: Sequence[Seam]) -> TileMesh:
    """Give the vertices on seams what the first tile that has them says.

    Parameters
    ----------
    mesh : TileMesh
        The mesh of a tile, settled.
    before : sequence of Seam
        Seams of the neighbours that come before this tile, in their order, settled.
    """
    changed = {
        name: getattr(mesh, name).copy()
        for name in ("vertices", "normals", "confidence", "beyond", "spacing")
    }
    own, free = Seam.of(mesh), np.ones(len(mesh.seam), bool)
    for seam in before:
        mine, its = shared(own, seam)
        mine, its = mine[free[mine]], its[free[mine]]
        for name, values in changed.items():
            values[mine] = getattr(seam, name)[its]
        free[mine] = False
    return replace(mesh, **changed)


@dataclass(frozen=True)
class Decision:
    """What was decided about patches and components, numbered tile by tile.

    Attributes
    ----------
    keep : sequence of (p,) bool
        For each tile, which of its patches stay.
    closing : Closing
        The decision in words.
    """

    keep: tuple[NDArray[np.bool_], ...]
    closing: Closing


def decide(
    sums: Sequence[Sums],
    patch_links: Sequence[tuple[int, int, Index]],
    component_links: Sequence[tuple[int, int, Index]],
    closes: bool,
) -> Decision:
    """Decide about the patches of all tiles.

    Parameters
    ----------
    sums : sequence of Sums
        One for each tile.
    patch_links, component_links : sequence of (int, int, (k, 2) int64)
        Numbers of two tiles, and pairs of numbers in them that are the same patch or component.
    closes : bool
        Whether holes may stay closed at all.
    """
    patch = unite([len(each.component) for each in sums], patch_links)
    component = unite([len(each.components.area) for each in sums], component_links)
    keep, without = merged(sums, patch, component).decide(closes)
    starts = np.cumsum([0, *(len(each.component) for each in sums)])
    rows = keep[patch]
    parts = tuple(rows[a:b] for a, b in pairwise(starts))
    return Decision(parts, described(keep, without, closes))


def unite(counts: Sequence[int], links: Sequence[tuple[int, int, Index]]) -> Index:
    """Return numbers, (n,), of what the tiles have, the same for what is linked."""
    starts = np.cumsum([0, *counts])
    pairs = [pair + np.array([starts[a], starts[b]]) for a, b, pair in links]
    a, b = np.concatenate([*pairs, np.zeros((0, 2), np.int64)]).T.astype(np.int64)
    n = int(starts[-1])
    graph = scipy.sparse.coo_matrix((np.ones(len(a)), (a, b)), shape=(n, n))
    return np.asarray(scipy.sparse.csgraph.connected_components(graph, directed=False)[1], np.int64)


def links_of(one: Seam, other: Seam) -> tuple[Index, Index]:
    """Return the pairs of patches, and of components, that two tiles share, (k, 2) each."""
    a, b = shared(one, other)
    patch = np.stack([one.patch[a], other.patch[b]], axis=1)
    component = np.stack([one.component[a], other.component[b]], axis=1)
    patch = np.unique(patch[(patch >= 0).all(axis=1)], axis=0)
    return patch, np.unique(component, axis=0)


@dataclass(frozen=True)
class Finished:
    """Final mesh of a tile.

    Attributes
    ----------
    vertices, normals : (v, 3) float64
    triangles : (t, 3) int32
    confidence : (v,) float64
    piece : (v,) int64
        Connected component within the tile.
    samples : (k,) int64
        Number of the tile's samples on each component.
    seam : (s,) int64
        Vertices that may belong to neighbours, too.
    """

    vertices: Array
    normals: Array
    triangles: NDArray[np.int32]
    confidence: Array
    piece: Index
    samples: Index
    seam: Index


def finish(mesh: TileMesh, closed: bool, samples: Array, options: Options) -> Finished:
    """Cut a tile's mesh where the surface ends.

    Parameters
    ----------
    mesh : TileMesh
        The mesh of the tile, as :func:`owned` returns it.
    closed : bool
        Whether nothing is cut, as the whole mesh stays closed.
    samples : (n, 3) float64
        The tile's samples.
    options : Options
        What the user has chosen.
    """
    vertices, triangles, confidence = mesh.vertices, mesh.triangles, mesh.confidence
    normals, fixed = mesh.normals, np.arange(len(vertices)) < len(mesh.seam)
    values, level = None, 0.0
    if options.trim is not None and options.trim != "auto":
        values, level = confidence, float(options.trim)
    elif options.closes is not True and not closed:
        values, level = -np.minimum(mesh.beyond, FAR), -EDGE
    if values is not None and len(triangles):
        border = boundary_edges(triangles)
        values = smoothed(values, level, vertices, triangles, mesh.spacing, fixed)
        vertices, triangles, confidence, ends = cut(vertices, triangles, confidence, values, level)
        spacing = mesh.spacing[ends].mean(axis=1)
        normals = unit(normals[ends].sum(axis=1))
        fixed = fixed[ends].all(axis=1) & (
            (ends[:, 0] == ends[:, 1]) | _among(ends, border, len(mesh.vertices))
        )
        vertices, triangles, used = tidy(vertices, triangles, spacing, fixed)
        confidence, normals, fixed = confidence[used], normals[used], fixed[used]
    piece = np.asarray(label_pieces(triangles, len(vertices)))
    count = np.zeros(int(piece.max(initial=-1)) + 1, np.int64)
    if len(vertices) and len(samples):
        tree = KdTree(np.ascontiguousarray(vertices), thread_count())
        nearest = tree.query(np.ascontiguousarray(samples), 1, np.inf)[1][:, 0]
        count += np.bincount(piece[nearest], minlength=len(count))
    return Finished(vertices, normals, triangles, confidence, piece, count, np.flatnonzero(fixed))


def _among(ends: Index, edges: NDArray[Any], n: int) -> NDArray[np.bool_]:
    """Return whether edges, (v, 2), are among others in either direction."""
    low, high = edges.min(axis=1).astype(np.int64), edges.max(axis=1)
    return np.isin(ends.min(axis=1) * n + ends.max(axis=1), low * n + high)
