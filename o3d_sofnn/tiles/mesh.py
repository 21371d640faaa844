"""The second half of the work on a tile, first part: its triangles, repaired, with their seams."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from o3d_sofnn._kernels import label_pieces, vertex_normals
from o3d_sofnn.implicit.far_field import FarField
from o3d_sofnn.implicit.field import Field
from o3d_sofnn.meshing.borders.closing import EDGE, Judge
from o3d_sofnn.meshing.borders.patches import Patches
from o3d_sofnn.meshing.borders.sums import Sums
from o3d_sofnn.meshing.isosurface.resolution import RESOLVES
from o3d_sofnn.meshing.repair.handles import open_handles
from o3d_sofnn.meshing.repair.relaxation import balance_chords, relax
from o3d_sofnn.meshing.repair.sharpening import sharpen
from o3d_sofnn.meshing.repair.untangling import untangle
from o3d_sofnn.rules.inference import infer_normals
from o3d_sofnn.tiles.blocks import Blocks, Run
from o3d_sofnn.tiles.dipoles import Dipoles
from o3d_sofnn.tiles.extraction import Extracted, extract
from o3d_sofnn.tiles.lattice import BLOCK, Box
from o3d_sofnn.tiles.patch import Patch

Array = NDArray[np.float64]


Triangles = NDArray[np.int32]


@dataclass(frozen=True)
class TileMesh:
    """Triangles of a tile, and what is known of their vertices; those on seams come first.

    Attributes
    ----------
    vertices, normals : (v, 3) float64
        Repaired positions, and unit normals.
    triangles : (t, 3) int32
        Open along the seams, closed elsewhere.
    seam : (s, 3) float64
        Names of the first s vertices: where marching cubes placed them, the same bits in all tiles
        that have them, in ascending order of z, y, x.
    confidence, beyond, spacing : (v,) float64
        Support by the data, distance beyond the data divided by the spacing, and the spacing.
    patch, component : (v,) int64
        Numbers of the patch that closes a hole, -1 for none, and of the connected component.
    """

    vertices: Array
    normals: Array
    triangles: Triangles
    seam: Array
    confidence: Array
    beyond: Array
    spacing: Array
    patch: NDArray[np.int64]
    component: NDArray[np.int64]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all arrays by name."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def mesh_tile(run: Run, own: Box, patch: Patch, dipoles: Dipoles) -> tuple[TileMesh, Sums]:
    """Triangulate a tile.

    Parameters
    ----------
    run : Run
        Figures of the run.
    own : Box
        The tile.
    patch : Patch
        Rules and samples of the tile and of its neighbours, tile by tile in the order of the run.
    dipoles : Dipoles
        What the blocks of the tile may see, in the same order.

    Returns
    -------
    mesh : TileMesh
        Its own triangles.
    sums : Sums
        Its share in what decides about closings.
    """
    found = extract(run, own, patch, Blocks(run, patch, dipoles))
    if not found.n_own:
        return nothing()
    implicit, spacing = _field_of(run, own, patch, dipoles)
    start = untangle([found.away, found.vertices], found.triangles)
    relaxed, confidence = relax(start, found.triangles, implicit)
    moved = sharpen(relaxed, found.triangles, implicit)
    moved = balance_chords(moved, found.triangles, 1.0 - implicit.noisiness)
    vertices = untangle([start, relaxed, moved], found.triangles)
    seam = found.seam
    opened, triangles, source = open_handles(
        vertices, found.triangles, implicit.spacing_at, vertices[seam]
    )
    own_ones = own_side(found, triangles)
    facing = np.asarray(vertex_normals(opened, triangles))
    solid = patch.samples.solid
    sample = implicit.nearest(opened, 1)[1][:, 0]
    judge = Judge(implicit, solid, spacing, True)
    distance, beyond = judge.distances(opened, facing, ~solid, solid[sample])
    near = np.flatnonzero(confidence[source] > 0.0)
    facing[near] = infer_normals(patch.rules, np.ascontiguousarray(opened[near]))[0]
    rows, triangles = _compact(triangles[own_ones], seam, len(opened))
    patches = Patches(opened[rows], triangles, beyond[rows] > EDGE)
    component = np.asarray(label_pieces(triangles, len(rows)))
    sums = Sums.of(
        patches,
        component,
        distance[rows],
        spacing[sample[rows]],
        patch.samples.normals[sample[rows]],
        solid[sample[rows]],
    )
    mesh = TileMesh(
        opened[rows],
        facing[rows],
        triangles,
        found.vertices[seam],
        confidence[source][rows],
        beyond[rows],
        spacing[sample[rows]],
        patches.number,
        component,
    )
    return mesh, sums


def nothing() -> tuple[TileMesh, Sums]:
    """Return the mesh of a tile without triangles."""
    places, row, number = np.zeros((0, 3)), np.zeros(0), np.zeros(0, np.int64)
    triangles = np.zeros((0, 3), np.int32)
    mesh = TileMesh(places, places, triangles, places, row, row, row, number, number)
    patches = Patches(places, triangles, np.zeros(0, bool))
    return mesh, Sums.of(patches, number, row, row, places, np.zeros(0, bool))


def _field_of(run: Run, own: Box, patch: Patch, dipoles: Dipoles) -> tuple[Field, Array]:
    """Return one field for all of the tile, for repairs, and the spacing of its samples."""
    samples = patch.samples
    edges = run.lattice.size * np.exp2(samples.levels(run.lattice))
    far = dipoles.far_from(own.grown(BLOCK))
    places = np.concatenate([samples.places, far.places])
    areas = np.concatenate([samples.areas, far.areas])
    moments = np.concatenate([samples.areas[:, None] * samples.normals, far.moments])
    field = Field(
        patch.rules,
        patch.surfaces,
        samples.places,
        samples.normals,
        np.maximum(samples.spacing, edges),
        FarField(places, areas, moments, run.level),
        run.noisiness,
    )
    return field, np.maximum(samples.spacing, RESOLVES * edges)


def own_side(found: Extracted, triangles: Triangles) -> NDArray[np.bool_]:
    """Mark the tile's own triangles after handles have been opened, on one side of its seam.

    Parameters
    ----------
    found : Extracted
        The mesh before.
    triangles : (t, 3) int32
        The mesh after: with the same edges along the seam.
    """
    n = max(int(triangles.max(initial=0)), len(found.vertices)) + 1
    before = _half_edges(found.triangles[: found.n_own], n)[0]
    other = _half_edges(found.triangles[found.n_own :], n)[0]
    border = before[np.isin(_turned(before, n), other)]
    keys, row = _half_edges(triangles, n)
    # Triangles are joined across all edges but those of the seam.
    seam = np.union1d(border, _turned(border, n))
    inner = ~np.isin(keys, seam)
    a, b = np.minimum(keys // n, keys % n)[inner], np.maximum(keys // n, keys % n)[inner]
    pair, row_of = a * n + b, row[inner]
    order = np.argsort(pair, kind="stable")
    first, second = row_of[order[0::2]], row_of[order[1::2]]
    graph = scipy.sparse.coo_matrix(
        (np.ones(len(first)), (first, second)), shape=(len(triangles), len(triangles))
    )
    piece = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    own = np.zeros(int(piece.max(initial=-1)) + 1, bool)
    own[piece[row[np.isin(keys, border)]]] = True
    # Pieces without a seam lie on one side; their old vertices tell on which.
    inside = np.zeros(n, bool)
    inside[found.triangles[: found.n_own]] = True
    inside[found.triangles[found.n_own :]] = False
    own[piece[inside[triangles].any(axis=1)]] = True
    return np.asarray(own[piece])


def _half_edges(triangles: Triangles, n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return keys of the directed edges of triangles, and the triangle of each."""
    start = triangles.astype(np.int64).ravel()
    end = triangles[:, [1, 2, 0]].astype(np.int64).ravel()
    return start * n + end, np.repeat(np.arange(len(triangles)), 3)


def _turned(keys: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    return np.asarray(keys % n * n + keys // n)


def _compact(
    triangles: Triangles, first: NDArray[np.int64], n: int
) -> tuple[NDArray[np.int64], Triangles]:
    """Return the vertices of triangles, some of them first, and the triangles by these."""
    used = np.zeros(n, bool)
    used[triangles] = True
    used[first] = False
    rows = np.concatenate([first, np.flatnonzero(used)])
    number = np.full(n, -1, np.int32)
    number[rows] = np.arange(len(rows), dtype=np.int32)
    return rows, number[triangles]
