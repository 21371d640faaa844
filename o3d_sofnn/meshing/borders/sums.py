"""Sums over patches and components that decide about closings; those of parts add up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.meshing.borders.patches import Patches

Array = NDArray[np.float64]


Index = NDArray[np.int64]


VOUCHED = 5.0
"""Distance from the data, divided by the spacing along the rim, up to which the rim supports the
closing of a hole."""


FACING = 0.2
"""Smallest mean cosine, on a solid, between a closing that reaches farther and the data at its rim.
It is 0.00 at ends of pipes and at boxes without a lid, 0.29 at the missing base of a figure, and
0.6 to 0.95 at missing patches of smooth solids."""


HOLE = 0.1
"""Largest area, on a solid, that was closed without the support of rims, divided by the area of the
data: 0.00 to 0.07 on scans from all around, at least 0.2 elsewhere."""


@dataclass(frozen=True)
class OfPatches:
    """Sums over p patches.

    Attributes
    ----------
    area, deepest : (p,) float64
        Area, and largest distance of a vertex from the data.
    rim, spacing, square : (p,) float64
        Number of edges to the rim, sum of the spacings there, and of their squares.
    whole, facing : (p, 3) float64
        Sum of the area-weighted normals, and of the normals of the data along the rim.
    """

    area: Array
    deepest: Array
    rim: Array
    spacing: Array
    square: Array
    whole: Array
    facing: Array


@dataclass(frozen=True)
class OfComponents:
    """Sums over c components.

    Attributes
    ----------
    vertices, solid : (c,) float64
        Number of vertices, and of those nearest to a sample on a solid.
    area, held : (c,) float64
        Area, and area on the data.
    """

    vertices: Array
    solid: Array
    area: Array
    held: Array


@dataclass(frozen=True)
class Sums:
    """Sums over the patches and components of a mesh.

    Attributes
    ----------
    patches : OfPatches
    components : OfComponents
    component : (p,) int64
        Component of each patch.
    """

    patches: OfPatches
    components: OfComponents
    component: Index

    @classmethod
    def of(
        cls,
        patches: Patches,
        component: Index,
        distance: Array,
        spacing: Array,
        normals: Array,
        solid: NDArray[np.bool_],
    ) -> Sums:
        """Sum over the vertices of a mesh.

        Parameters
        ----------
        patches : Patches
            The patches of the mesh.
        component : (m,) int64
            Component of each vertex.
        distance, spacing : (m,) float64
            Distance from the data, and spacing of the nearest sample.
        normals : (m, 3) float64
            Normals of the nearest samples.
        solid : (m,) bool
            Whether the nearest sample is on a solid.
        """
        p, c = patches.count, int(component.max(initial=-1)) + 1
        loose, own = patches.loose, patches.number[patches.loose]
        deepest = np.zeros(p)
        np.maximum.at(deepest, own, distance[loose])
        of_component = np.zeros(p, np.int64)
        of_component[own] = component[loose]

        rim, patch = patches.rim, patches.patch
        of_patches = OfPatches(
            _sum(own, patches.areas[loose], p),
            deepest,
            _sum(patch, np.ones(len(patch)), p),
            _sum(patch, spacing[rim], p),
            _sum(patch, spacing[rim] ** 2, p),
            _sum(own, patches.normals[loose], p),
            _sum(patch, normals[rim], p),
        )
        of_components = OfComponents(
            _sum(component, np.ones(len(component)), c),
            _sum(component, solid.astype(np.float64), c),
            _sum(component, patches.areas, c),
            _sum(component, patches.areas * ~loose, c),
        )
        return cls(of_patches, of_components, of_component)

    def decide(self, closes: bool) -> tuple[NDArray[np.bool_], float]:
        """Decide which patches stay, (p,), and return the share of the area that no rim supports.

        Parameters
        ----------
        closes : bool
            Whether holes may stay closed at all.
        """
        of, c = self.patches, self.components
        # Along a rim of varying density, the mean is weighted by length.
        along = of.square / np.maximum(of.spacing, 1e-300)
        deep = of.deepest > VOUCHED * along
        without = np.bincount(self.component, of.area * deep, len(c.area))
        solid = (2.0 * c.solid > c.vertices) & (without <= HOLE * c.held)
        length = np.maximum(np.linalg.norm(of.whole, axis=1), 1e-300)
        rim = np.maximum(of.rim, 1.0)[:, None]
        cosine = np.einsum("pd,pd->p", of.facing / rim, of.whole) / length
        missing = (cosine >= FACING) & solid[self.component] & (of.rim > 0.0)
        keep = (~deep | missing) & closes
        return keep, float(without.sum() / max(c.area.sum(), 1e-300))


def merged(parts: Sequence[Sums], patch: Index, component: Index) -> Sums:
    """Add up the sums of parts of a mesh.

    Parameters
    ----------
    parts : sequence of Sums
        The parts.
    patch, component : (p,) and (c,) int64
        Number in the mesh of each patch and component of the parts, one part after the other.
    """
    of_patches = _added([part.patches for part in parts], patch)
    deepest = np.zeros(len(of_patches.area))
    np.maximum.at(deepest, patch, np.concatenate([part.patches.deepest for part in parts]))
    starts = np.cumsum([0, *(len(part.components.area) for part in parts)])
    of = np.zeros(len(deepest), np.int64)
    rows = [part.component + start for part, start in zip(parts, starts, strict=False)]
    of[patch] = component[np.concatenate(rows)]
    return Sums(
        OfPatches(**{**vars(of_patches), "deepest": deepest}),
        _added([part.components for part in parts], component),
        of,
    )


def _added(tables: Sequence[OfPatches] | Sequence[OfComponents], row: Index) -> Any:
    """Add up the rows with the same number."""
    count, found = int(row.max(initial=-1)) + 1, {}
    for field in fields(tables[0]):
        values = np.concatenate([getattr(table, field.name) for table in tables])
        found[field.name] = _sum(row, values, count)
    return type(tables[0])(**found)


def _sum(row: Index, values: NDArray[Any], count: int) -> Array:
    """Return the sums of the values, (k,) or (k, 3), with the same number."""
    if values.ndim == 1:
        return np.asarray(np.bincount(row, values, count), np.float64)
    return np.stack([np.bincount(row, column, count) for column in values.T], axis=1)
