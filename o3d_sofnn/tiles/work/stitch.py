"""One mesh of all tiles: vertices on seams once, components without samples not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.files.outputs import open_atomic
from o3d_sofnn.meshing.borders.trimming import SAMPLES
from o3d_sofnn.tiles.borders import Finished, names_of, unite

Array = NDArray[np.float64]


Index = NDArray[np.int64]


@dataclass(frozen=True)
class Part:
    """The share of one tile in the mesh of all.

    Attributes
    ----------
    vertices, normals : (v, 3) float64
        Its own vertices; those of earlier tiles are not repeated.
    confidence : (v,) float64
    triangles : (t, 3) int64
        By vertices of the whole mesh.
    number : (n,) int64
        Index in the whole mesh of each vertex of the tile, -1 for those that were left out.
    """

    vertices: Array
    normals: Array
    confidence: Array
    triangles: Index
    number: Index


@dataclass(frozen=True)
class Whole:
    """Figures of the mesh of all tiles.

    Attributes
    ----------
    vertices, triangles, components, border_edges : int
        Their numbers.
    """

    vertices: int
    triangles: int
    components: int
    border_edges: int


def kept_pieces(
    near: Sequence[Sequence[int]], finished: Callable[[int], Finished]
) -> tuple[list[NDArray[np.bool_]], int]:
    """Return for each tile which of its pieces stay, and the number of components that do.

    A component is left out if it has hardly any samples in all tiles together.

    Parameters
    ----------
    near : sequence of sequence of int
        For each tile, the earlier ones that it touches.
    finished : callable
        Returns the mesh of a tile.
    """
    counts, sizes = [], []
    links: list[tuple[int, int, Index]] = []
    open_seams: dict[int, tuple[NDArray[np.void], Index]] = {}
    for tile, touched in enumerate(near):
        part = finished(tile)
        names, piece = names_of(part.vertices[part.seam]), part.piece[part.seam]
        for other in touched:
            _, a, b = np.intersect1d(open_seams[other][0], names, True, True)
            pair = np.stack([open_seams[other][1][a], piece[b]], axis=1)
            links.append((other, tile, np.unique(pair, axis=0)))
        open_seams[tile] = names, piece
        counts.append(part.samples)
        sizes.append(len(part.samples))
    label = unite(sizes, links)
    total = np.bincount(label, np.concatenate([*counts, np.zeros(0)]))
    stays = total >= min(SAMPLES, int(total.max(initial=0)))
    parts = np.split(stays[label], np.cumsum(sizes)[:-1])
    return list(parts), int(stays.sum())


def stitched(
    near: Sequence[Sequence[int]],
    finished: Callable[[int], Finished],
    pieces: Sequence[NDArray[np.bool_]],
) -> Iterator[Part]:
    """Yield the share of each tile in the mesh of all, in the order of the tiles."""
    seams: dict[int, tuple[NDArray[np.void], Index]] = {}
    last = {each: tile for tile, touched in enumerate(near) for each in (*touched, tile)}
    count = 0
    for tile, touched in enumerate(near):
        part = finished(tile)
        used = pieces[tile][part.piece] if len(part.piece) else np.zeros(0, bool)
        number = np.full(len(part.vertices), -1)
        names = names_of(part.vertices[part.seam])
        for other in touched:
            _, a, b = np.intersect1d(seams[other][0], names, True, True)
            number[part.seam[b]] = np.where(used[part.seam[b]], seams[other][1][a], -1)
        new = np.flatnonzero(used & (number < 0))
        number[new] = count + np.arange(len(new))
        count += len(new)
        seams[tile] = names, number[part.seam]
        for each in [each for each in seams if last[each] <= tile]:
            del seams[each]
        triangles = number[part.triangles[used[part.triangles[:, 0]]]]
        yield Part(part.vertices[new], part.normals[new], part.confidence[new], triangles, number)


VERTEX = np.dtype(
    [("x", "<f8", 3), ("n", "<f4", 3), ("confidence", "<f4")],
)
"""One vertex in the file."""


def write_ply(path: Path, parts: Iterator[Part], place: Callable[[Array], Array]) -> Whole:
    """Write a mesh part by part, whole or not at all.

    Parameters
    ----------
    path : Path
        Where to write.
    parts : iterator of Part
        The parts.
    place : callable
        Moves vertices to the user's coordinates.

    Raises
    ------
    OSError
        The disk is full or the folder not writable; the message names the file.
    """
    vertices = triangles = 0
    low = np.zeros(0, np.int64)
    try:
        with (
            tempfile.TemporaryFile(dir=path.parent) as points,
            tempfile.TemporaryFile(dir=path.parent) as faces,
            open_atomic(path) as stream,
        ):
            for part in parts:
                rows = np.empty(len(part.vertices), VERTEX)
                rows["x"], rows["n"] = place(part.vertices), part.normals
                rows["confidence"] = part.confidence
                points.write(rows.tobytes())
                index = np.empty(len(part.triangles), np.dtype([("k", "u1"), ("v", "<u4", 3)]))
                index["k"], index["v"] = 3, part.triangles
                faces.write(index.tobytes())
                vertices += len(rows)
                triangles += len(index)
                low = _open_edges(low, part.triangles)
            stream.write(_header(vertices, triangles).encode())
            for body in (points, faces):
                body.seek(0)
                shutil.copyfileobj(body, stream, 1 << 20)
    except OSError as error:
        error.filename = error.filename or str(path)
        raise
    return Whole(vertices, triangles, 0, len(low))


def _open_edges(known: Index, triangles: Index) -> Index:
    """Return the keys of edges that only one triangle has had so far."""
    start, end = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    keys = np.minimum(start, end) << 32 | np.maximum(start, end)
    keys, count = np.unique(np.concatenate([known, keys]), return_counts=True)
    return np.asarray(keys[count == 1])


def _header(vertices: int, triangles: int) -> str:
    return (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {vertices}\n"
        "property double x\nproperty double y\nproperty double z\n"
        "property float nx\nproperty float ny\nproperty float nz\n"
        "property float confidence\n"
        f"element face {triangles}\n"
        "property list uchar uint vertex_indices\nend_header\n"
    )
