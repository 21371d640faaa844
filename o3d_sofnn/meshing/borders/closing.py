"""Where the mesh stays closed: on what the data say is a solid, and where rims vouch for a hole.

The extraction closes everything. What it has closed beyond the data falls into patches, each with a
rim on the data, and each is judged by its own rim and its own component.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, label_pieces, vertex_normals
from o3d_sofnn.meshing.borders.patches import Patches

if TYPE_CHECKING:
    from o3d_sofnn.implicit.field import Field

EDGE = 1.15
"""Distance from the samples, over their spacing, at which the surface ends: gaps between samples
drawn at random are narrower."""


VOUCHED = 5.0
"""Distance from the data, over the spacing along the rim, up to which that vouches for what closes
a hole."""


FACING = 0.2
"""Least mean cosine between a closing that reaches farther, on a solid, and the data at its rim:
0.00 at ends of pipes and boxes without a lid, 0.29 at the missing base of a figure, 0.6 to 0.95 at
missing patches of smooth solids."""


HOLE = 0.1
"""Largest area that was closed beyond what rims vouch for, over that of the data, on a solid: 0.00
to 0.07 on scans all around, from 0.2 on elsewhere."""


FEW = 64
"""Samples below which nothing says that a surface is open, unless it is flat: it is closed."""


NEAREST = 8
"""Samples of which one has to face as a vertex does: those of both sheets of a thin part."""


FLAT = 1e-6
"""Thickness of a flat cloud over its size."""


BLOCK = 2**16
"""Vertices that are looked at together: each needs some fifty numbers."""


Array = NDArray[np.float64]


Triangles = NDArray[np.int32]


@dataclass(frozen=True)
class Closing:
    """What was closed, what was left open, and why.

    Attributes
    ----------
    closed : bool
        Whether the mesh is closed.
    unsupported : float
        Share of the area of the closed mesh that no rim vouches for: about 0 on a solid.
    holes_closed, holes_open : int
        Holes of the data of either kind.
    reason : str
        The decision in words, with the figure, and how to choose otherwise.
    """

    closed: bool
    unsupported: float
    holes_closed: int
    holes_open: int
    reason: str


class Judge:
    """Judges what closes a mesh.

    Parameters
    ----------
    implicit : Field
        The function, with its samples.
    solid : (n,) bool
        What :func:`o3d_sofnn.meshing.borders.solids.solids` says of its samples.
    spacing : (n,) float64
        Distance of neighbouring samples at each, not less than what the mesh resolves.
    closes : bool
        Whether holes may stay closed at all.
    """

    def __init__(
        self, implicit: Field, solid: NDArray[np.bool_], spacing: Array, closes: bool
    ) -> None:
        self._field, self._solid = implicit, solid
        self._spacing, self._closes = spacing, closes

    def __call__(self, vertices: Array, triangles: Triangles) -> tuple[Array, Closing]:
        """Tell how far beyond the data a closed mesh is.

        Parameters
        ----------
        vertices : (m, 3) float64
        triangles : (t, 3) int32
            A closed mesh.

        Returns
        -------
        beyond : (m,) float64
            Distance from samples that face alike over their spacing, up to twice `VOUCHED`; 0 in
            holes that stay closed. The surface ends at `EDGE`.
        closing : Closing
        """
        component = np.asarray(label_pieces(triangles, len(vertices)))
        distance, beyond, sample = self._distances(vertices, triangles, component)
        spacing = self._spacing[sample]
        patches = Patches(vertices, triangles, beyond > EDGE)
        # Along a rim that is dense here and sparse there the mean by length.
        along = patches.on_rim(spacing**2) / np.maximum(patches.on_rim(spacing), 1e-300)
        deep = patches.largest(distance) > VOUCHED * along
        supported = np.bincount(component, patches.areas * ~patches.loose)
        without = np.bincount(component, patches.areas * (patches.loose & deep[patches.label]))
        solid = self._mostly_solid(sample, component) & (without <= HOLE * supported)
        unsupported = float(without.sum() / max(patches.areas.sum(), 1e-300))
        missing = patches.facing(self._field.normals[sample]) >= FACING
        missing &= patches.on_rim(solid[component].astype(np.float64)) > 0.5
        keep = (~deep | missing) & self._closes
        if len(self._spacing) < FEW and not _is_flat(self._field.samples):
            keep[:] = self._closes
        beyond[patches.loose & keep[patches.label]] = 0.0
        number = np.unique(patches.label[patches.loose])
        return beyond, _closing(keep[number], unsupported, self._closes)

    def _distances(
        self, vertices: Array, triangles: Triangles, component: NDArray[np.int64]
    ) -> tuple[Array, Array, NDArray[np.int64]]:
        """Distances from samples that face alike, also over their spacing, and the nearest sample.

        A sample that the mesh faces nowhere, or on a solid, counts whatever its side.
        """
        facing = np.asarray(vertex_normals(vertices, triangles))
        sample = self._field.nearest(vertices, 1)[1][:, 0]
        any_side = self._mostly_solid(sample, component)[component]
        faced = np.zeros(len(self._spacing), bool)
        faced[sample[~any_side]] = True
        faced[faced] = self._faced(vertices, facing, np.flatnonzero(faced))
        distance, beyond = np.full(len(vertices), np.inf), np.full(len(vertices), np.inf)
        for start in range(0, len(vertices), BLOCK):
            rows = slice(start, start + BLOCK)
            near, index = self._field.nearest(vertices[rows], NEAREST)
            alike = np.einsum("mkd,md->mk", self._field.normals[index], facing[rows]) > 0.0
            alike |= ~faced[index] | any_side[rows, None]
            distance[rows] = np.where(alike, near, np.inf).min(axis=1)
            beyond[rows] = np.where(alike, near / self._spacing[index], np.inf).min(axis=1)
        return distance, np.minimum(beyond, 2.0 * VOUCHED), sample

    def _mostly_solid(
        self, sample: NDArray[np.int64], component: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Whether most of the vertices of each component have a sample of a solid nearest."""
        count = np.bincount(component)
        return np.asarray(2 * np.bincount(component, self._solid[sample]) > count)

    def _faced(self, vertices: Array, facing: Array, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether a vertex near to each of some samples faces as the sample does."""
        if not len(rows):
            return np.zeros(0, bool)
        n_threads = self._field.n_threads
        tree = KdTree(vertices, n_threads)
        samples = np.ascontiguousarray(self._field.samples[rows])
        index = tree.query(samples, min(NEAREST, len(vertices)), np.inf, n_threads)[1]
        cosine = np.einsum("skd,sd->sk", facing[index], self._field.normals[rows])
        return np.asarray((cosine > 0.0).any(axis=1))


def _is_flat(points: Array) -> bool:
    """Whether points lie in one plane, to rounding."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[-1] <= FLAT * spread[0])


def _closing(keep: NDArray[np.bool_], unsupported: float, closes: bool) -> Closing:
    """Put a decision into words."""
    share = f"{100.0 * unsupported:.0f} % of the closed mesh is beyond what the data vouch for"
    if not closes:
        reason = f"open, as asked for ({share})"
    elif keep.all():
        reason = f"closed: {share}; closed=False leaves every hole open"
    else:
        reason = f"open: {share}; closed=True closes it all the same"
    return Closing(bool(keep.all()), unsupported, int(keep.sum()), int((~keep).sum()), reason)
