"""Where the mesh stays closed: on solids, and where the rim of a hole supports its closing.

The extraction closes everything. The parts closed beyond the data form patches, each with a rim on
the data, and each patch is judged by its own rim and its own connected component.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, label_pieces, vertex_normals
from o3d_sofnn.meshing.borders.patches import Patches
from o3d_sofnn.meshing.borders.sums import VOUCHED, Sums
from o3d_sofnn.threads import thread_count

if TYPE_CHECKING:
    from o3d_sofnn.implicit.field import Field

EDGE = 1.15
"""Distance from the samples, divided by their spacing, at which the surface ends: gaps between
randomly drawn samples are narrower."""


FEW = 64
"""A surface of fewer samples is closed unless it is flat, because nothing shows that it is open."""


NEAREST = 8
"""Number of nearest samples, at least one of which must face the same way as a vertex: they include
those on both sheets of a thin part."""


FLAT = 1e-6
"""Thickness of a flat cloud, divided by its size."""


BLOCK = 2**16
"""Number of vertices that are processed together: each needs about fifty numbers."""


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
        Share of the area of the closed mesh that no rim supports: about 0 on a solid.
    holes_closed, holes_open : int
        Number of holes in the data that were closed, and that were left open.
    reason : str
        The decision in words, with the figure, and how to choose otherwise.
    """

    closed: bool
    unsupported: float
    holes_closed: int
    holes_open: int
    reason: str


class Judge:
    """Decides which closings of a closed mesh are kept.

    Parameters
    ----------
    implicit : Field
        The function, with its samples.
    solid : (n,) bool
        Samples on solids, as found by :func:`o3d_sofnn.meshing.borders.solids.solids`.
    spacing : (n,) float64
        Distance between neighbouring samples, or the resolution of the mesh if that is coarser.
    closes : bool
        Whether holes may stay closed at all.
    """

    def __init__(
        self, implicit: Field, solid: NDArray[np.bool_], spacing: Array, closes: bool
    ) -> None:
        self._field, self._solid = implicit, solid
        self._spacing, self._closes = spacing, closes

    def __call__(self, vertices: Array, triangles: Triangles) -> tuple[Array, Closing]:
        """Measure how far the vertices of a closed mesh are beyond the data.

        Parameters
        ----------
        vertices : (m, 3) float64
        triangles : (t, 3) int32
            A closed mesh.

        Returns
        -------
        beyond : (m,) float64
            Distance from samples that face the same way, divided by their spacing, up to twice
            `VOUCHED`; 0 in holes that stay closed. The surface ends at `EDGE`.
        closing : Closing
        """
        component = np.asarray(label_pieces(triangles, len(vertices)))
        facing = np.asarray(vertex_normals(vertices, triangles))
        sample = self._field.nearest(vertices, 1)[1][:, 0]
        any_side = self._mostly_solid(sample, component)[component]
        sided = np.zeros(len(self._spacing), bool)
        sided[sample[~any_side]] = True
        distance, beyond = self.distances(vertices, facing, sided, any_side)
        patches = Patches(vertices, triangles, beyond > EDGE)
        sums = Sums.of(
            patches,
            component,
            distance,
            self._spacing[sample],
            self._field.normals[sample],
            self._solid[sample],
        )
        keep, without = sums.decide(self._closes)
        if len(self._spacing) < FEW and not _is_flat(self._field.samples):
            keep[:] = self._closes
        beyond[patches.loose & np.append(keep, False)[patches.number]] = 0.0
        return beyond, described(keep, without, self._closes)

    def distances(
        self, vertices: Array, facing: Array, sided: NDArray[np.bool_], any_side: NDArray[np.bool_]
    ) -> tuple[Array, Array]:
        """Return distances to samples that face the same way, and relative to their spacing.

        Parameters
        ----------
        vertices, facing : (m, 3) float64
            Vertices and their unit normals.
        sided : (n,) bool
            Samples that count for one side only: the one that they face, if the mesh faces it
            somewhere.
        any_side : (m,) bool
            Vertices for which samples count whichever way they face.

        Returns
        -------
        distance, beyond : (m,) float64
        """
        faced = sided.copy()
        faced[faced] = self._faced(vertices, facing, np.flatnonzero(faced))
        distance, beyond = np.full(len(vertices), np.inf), np.full(len(vertices), np.inf)
        for start in range(0, len(vertices), BLOCK):
            rows = slice(start, start + BLOCK)
            near, index = self._field.nearest(vertices[rows], NEAREST)
            alike = np.einsum("mkd,md->mk", self._field.normals[index], facing[rows]) > 0.0
            alike |= ~faced[index] | any_side[rows, None]
            distance[rows] = np.where(alike, near, np.inf).min(axis=1)
            beyond[rows] = np.where(alike, near / self._spacing[index], np.inf).min(axis=1)
        return distance, np.minimum(beyond, 2.0 * VOUCHED)

    def _mostly_solid(
        self, sample: NDArray[np.int64], component: NDArray[np.int64]
    ) -> NDArray[np.bool_]:
        """Mark components of which most vertices are nearest to a sample on a solid."""
        count = np.bincount(component)
        return np.asarray(2 * np.bincount(component, self._solid[sample]) > count)

    def _faced(self, vertices: Array, facing: Array, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Mark samples near which some vertex faces the same way."""
        if not len(rows):
            return np.zeros(0, bool)
        tree = KdTree(vertices, thread_count())
        samples = np.ascontiguousarray(self._field.samples[rows])
        index = tree.query(samples, min(NEAREST, len(vertices)), np.inf)[1]
        cosine = np.einsum("skd,sd->sk", facing[index], self._field.normals[rows])
        return np.asarray((cosine > 0.0).any(axis=1))


def _is_flat(points: Array) -> bool:
    """Return whether points lie in one plane, up to rounding."""
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[-1] <= FLAT * spread[0])


def described(keep: NDArray[np.bool_], unsupported: float, closes: bool) -> Closing:
    """Describe a decision in words."""
    share = f"{100.0 * unsupported:.0f} % of the closed mesh is not supported by the data"
    if not closes:
        reason = f"open, as requested ({share})"
    elif keep.all():
        reason = f"closed: {share}; closed=False leaves every hole open"
    else:
        reason = f"open: {share}; closed=True closes it anyway"
    return Closing(bool(keep.all()), unsupported, int(keep.sum()), int((~keep).sum()), reason)
