"""Pieces, handles and triangles of reconstructed closed meshes: ``python topology.py MESH ...``.

The truth is the mesh that the points are drawn from. With ``--where`` a second table says how thin
the true shape is at every piece too many and at every handle that it does not have: how far the
next sheet is, straight through the surface or straight in front of it, in spacings.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from flips import Surface
from numpy.typing import NDArray
from truth import Case, draw, parser, read_closed

from o3d_sofnn import _kernels
from o3d_sofnn.geometry.mesh_properties import component_labels, euler_characteristic
from o3d_sofnn.pipeline import reconstruct_surface

Array = NDArray[Any]

REACHES = 4.0 * 1.4 ** np.arange(13)
"""Radii of balls in which handles are looked for, in spacings: the small ones come first."""
ROUNDS = 3
"""Times that each ball is tried: what was found for one handle may lie at another one."""


def shape(vertices: NDArray[Any], triangles: NDArray[Any]) -> tuple[int, int]:
    """Return the number of pieces of a closed mesh and the sum of their genera."""
    _, joined = np.unique(vertices, axis=0, return_inverse=True)  # files may repeat vertices
    triangles = joined.reshape(-1)[triangles]
    pieces = component_labels(triangles)[0]
    return pieces, pieces - euler_characteristic(triangles) // 2


def cutting(vertices: Array, triangles: Array) -> int:
    """Count the triangles that cut others."""
    everything = np.ones(len(triangles), bool)
    return len(np.unique(_kernels.intersecting_pairs(vertices, triangles, everything, 1)))


def loops(vertices: Array, triangles: Array, spacing: float) -> Iterator[Array]:
    """Cut every handle of a closed mesh open along a short loop, and yield the loops.

    Yields
    ------
    (k, 3) float64
        Vertices of a loop.
    """
    for reach in np.repeat(REACHES * spacing, ROUNDS):
        edges = np.asarray(_kernels.handle_edges(vertices, triangles))
        radius = np.full(len(edges), reach)
        opened = _kernels.open_handles(vertices, triangles, edges, radius, len(triangles))
        vertices, changed = map(np.asarray, opened[:2])
        lids = changed[len(triangles) :: 2]  # in turn those on the left and on the right of a cut
        for first in np.unique(lids[:, 0]):
            yield vertices[np.unique(lids[lids[:, 0] == first, 1:])]
        triangles = changed


def wrong_places(
    vertices: Array, triangles: Array, truth: Surface, pieces: int, spacing: float
) -> Iterator[tuple[str, Array]]:
    """Find pieces and handles that the truth does not have.

    The inside of a loop lies inside of one surface and outside of the other one where the handle is
    wrong: there the mesh has a bridge, or a tunnel.

    Parameters
    ----------
    vertices, triangles : (v, 3) float64 and (t, 3) int32
        A reconstruction.
    truth : Surface
        What it should be.
    pieces : int
        Pieces that the truth has.
    spacing : float
        Of the points.

    Yields
    ------
    what : str
    places : (k, 3) float64
    """
    label = component_labels(triangles)[1]
    sizes = np.bincount(label)
    for piece in np.argsort(-sizes, kind="stable")[pieces:]:
        yield "piece", vertices[np.unique(triangles[label == piece])]
    ours = Surface(vertices, triangles)
    for loop in loops(vertices, triangles, spacing):
        middle = loop.mean(axis=0)[None]
        if truth.holds(middle) != ours.holds(middle):
            yield "bridge" if ours.holds(middle) else "tunnel", loop


def main() -> int:
    """Print a line for each mesh and noise level."""
    arguments = parser(__doc__, points=100_000)
    arguments.add_argument("--where", action="store_true", help="how thin it is at what is wrong")
    options = arguments.parse_args()
    print("| cloud | pieces | of the truth | genus | of the truth | triangles | that cut others |")
    print("|---|---|---|---|---|---|---|")
    lines = []
    for file in options.meshes:
        mesh = read_closed(file)
        truth = shape(*mesh)
        for noise in options.noise:
            surface = reconstruct_surface(draw(Case(file, options.n, noise)).points)
            ours = shape(surface.vertices, surface.triangles)
            print(
                f"| {file.stem}, {noise:g} % | {ours[0]} | {truth[0]} | {ours[1]} | {truth[1]} "
                f"| {len(surface.triangles)} | {cutting(surface.vertices, surface.triangles)} |",
                flush=True,
            )
            if not options.where:
                continue
            known, spacing = Surface(*mesh), surface.normals.spacing
            for what, places in wrong_places(
                surface.vertices, surface.triangles, known, truth[0], spacing
            ):
                gap = known.next_sheet(*known.closest(places)) / spacing
                lines.append(
                    f"| {file.stem}, {noise:g} % | {what} | {gap.min():.2f} | {np.median(gap):.2f} "
                    f"| {np.ptp(places, axis=0).max() / spacing:.1f} |"
                )
    if lines:
        print("\n| cloud | what is wrong | next sheet: least | median | size |")
        print("|---|---|---|---|---|", *lines, sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
