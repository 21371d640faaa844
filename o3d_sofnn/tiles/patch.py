"""What a tile knows of its surface: rules, samples and dipoles, to be handed to its neighbours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.implicit.units import LocalSurfaces
from o3d_sofnn.meshing.isosurface.resolution import SHEET, Fits, steps_of
from o3d_sofnn.rules.rule_base import RuleBase
from o3d_sofnn.tiles.lattice import TOP, Lattice

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """Samples on the surface.

    Attributes
    ----------
    places, normals : (n, 3) float64
        Points moved onto the surface, and unit normals.
    spacing : (n,) float64
        Distance between neighbouring samples.
    areas : (n,) float64
        Area that each represents as a dipole.
    solid : (n,) bool
        Samples on solids.
    flat, radius, confidence : (n,) float64
        Of the nearest rule: edge of a cube in which the surface is flat, radius, and confidence
        (1 on sheets, whose thickness the winding number does not show).
    """

    places: Array
    normals: Array
    spacing: Array
    areas: Array
    solid: NDArray[np.bool_]
    flat: Array
    radius: Array
    confidence: Array

    def levels(self, lattice: Lattice) -> NDArray[np.int64]:
        """Return the levels of the leaves around the samples, (n,)."""
        if not lattice.usual:
            return np.zeros(len(self.places), np.int64)
        size = lattice.size * 2.0**lattice.usual
        fits = Fits(self.flat, self.radius, self.confidence)
        steps = steps_of(np.where(self.solid, 1.0, SHEET) * self.spacing, fits, size)
        return np.clip(steps + lattice.usual, 0, TOP)


@dataclass(frozen=True)
class Patch:
    """Part of a surface.

    Attributes
    ----------
    rules : RuleBase
        The r rules of this part.
    surfaces : LocalSurfaces
        Their local implicits.
    samples : Samples
        The samples of this part.
    """

    rules: RuleBase
    surfaces: LocalSurfaces
    samples: Samples

    def within(self, low: Array, high: Array) -> Patch:
        """Return the part in a box of space, in the same order."""
        return Patch(
            rows_of(self.rules, _inside(self.rules.centers, low, high)),
            rows_of(self.surfaces, _inside(self.rules.centers, low, high)),
            rows_of(self.samples, _inside(self.samples.places, low, high)),
        )

    def taken(self, rules: NDArray[Any], samples: NDArray[Any]) -> Patch:
        """Return the part with some rows, by indices or masks."""
        return Patch(
            rows_of(self.rules, rules),
            rows_of(self.surfaces, rules),
            rows_of(self.samples, samples),
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return all arrays by name."""
        parts = (("rules", self.rules), ("surfaces", self.surfaces), ("samples", self.samples))
        return {
            f"{prefix}.{field.name}": getattr(part, field.name)
            for prefix, part in parts
            for field in fields(part)
        }

    @classmethod
    def of(cls, arrays: Any) -> Patch:
        """Return the patch of such arrays."""

        def part(kind: Any, prefix: str) -> Any:
            return kind(**{f.name: arrays[f"{prefix}.{f.name}"] for f in fields(kind)})

        return cls(
            part(RuleBase, "rules"), part(LocalSurfaces, "surfaces"), part(Samples, "samples")
        )


def joined(patches: Sequence[Patch]) -> Patch:
    """Join parts of a surface in their order."""
    arrays = [patch.arrays() for patch in patches]
    return Patch.of({name: np.concatenate([each[name] for each in arrays]) for name in arrays[0]})


def rows_of(table: Any, rows: NDArray[Any]) -> Any:
    """Return some rows of a table, a dataclass of arrays."""
    return type(table)(**{f.name: getattr(table, f.name)[rows] for f in fields(table)})


def _inside(x: Array, low: Array, high: Array) -> NDArray[np.bool_]:
    return np.asarray(((x >= low) & (x < high)).all(axis=1))
