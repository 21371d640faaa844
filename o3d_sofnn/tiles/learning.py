"""The first half of the work on a tile: from points to a part of the surface."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.algorithm2 import Function
from o3d_sofnn.implicit.far_field import dipole_areas
from o3d_sofnn.implicit.units import LocalSurfaces
from o3d_sofnn.meshing.isosurface.resolution import Fits, flat_edges
from o3d_sofnn.rules.rule_base import RuleBase
from o3d_sofnn.threads import thread_count
from o3d_sofnn.tiles.patch import Patch, Samples

Array = NDArray[np.float64]


def patch_of(function: Function) -> Patch:
    """Return all of an implicit function as one patch, in its unit.

    Parameters
    ----------
    function : Function
        What :func:`o3d_sofnn.algorithm2.implicit_function` returns.
    """
    field = function.implicit
    return make_patch(
        (field.rules, field.surfaces),
        (function.on_surface, field.normals),
        function.spacing,
        function.on_solid,
    )


def make_patch(
    parts: tuple[RuleBase, LocalSurfaces],
    samples: tuple[Array, Array],
    spacing: Array,
    solid: NDArray[np.bool_],
) -> Patch:
    """Make a patch of the surface.

    Parameters
    ----------
    parts : RuleBase and LocalSurfaces
        Rules and their local surfaces.
    samples : (n, 3) and (n, 3) float64
        Points on the surface in Morton order, and their unit normals.
    spacing : (n,) float64
        Distance between neighbouring samples.
    solid : (n,) bool
        Samples on solids.
    """
    rules, (places, normals) = parts[0], samples
    nearest = KdTree(rules.centers, thread_count()).query(places, 1, np.inf, thread_count())
    fits = Fits.at(rules, flat_edges(rules), nearest[1][:, 0])
    areas = dipole_areas(places, spacing)
    confidence = np.where(solid, fits.confidence, 1.0)
    return Patch(
        *parts,
        Samples(places, normals, spacing, areas, solid, fits.flat, fits.radius, confidence),
    )
