"""Algorithm 2 with section 4: make an implicit function from rules, and mesh its zero set."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.geometry.checks import check_mesh
from o3d_sofnn.geometry.vectors import longest_side
from o3d_sofnn.implicit.far_field import FarField
from o3d_sofnn.implicit.field import Field
from o3d_sofnn.implicit.units import LocalSurfaces, local_surfaces
from o3d_sofnn.meshing.borders.closing import Closing, Judge
from o3d_sofnn.meshing.borders.solids import solids
from o3d_sofnn.meshing.borders.sums import VOUCHED
from o3d_sofnn.meshing.isosurface.resolution import RESOLVES, SHEET, choose_cubes
from o3d_sofnn.meshing.isosurface.spacing import local_spacing
from o3d_sofnn.meshing.mesh import mesh
from o3d_sofnn.options import Options
from o3d_sofnn.progress import Clock
from o3d_sofnn.rules.rule_base import RuleBase

if TYPE_CHECKING:
    from o3d_sofnn.algorithm1 import Learned
    from o3d_sofnn.sampling.outliers import Samples

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Function:
    """An implicit function that is zero on the surface, and the resolution to sample it at.

    Attributes
    ----------
    rules : RuleBase
        Oriented rules, in the unit cube.
    implicit : Field
        The function, with the m samples that it was made from.
    on_surface : (m, 3) float64
        Samples moved onto the surface.
    on_solid : (m,) bool
        Samples on parts that are solids according to the winding number.
    spacing : (m,) float64
        Distance between neighbouring samples, or the resolution of the cubes if that is coarser.
    size, finest : float
        Edge of a cube where the spacing is typical, and of the finest cubes.
    levels : (m,) int64
        The cubes around a sample have an edge of ``finest * 2**level``.
    offset_points : int
        Number of off-surface points that Algorithm 2 used.
    """

    rules: RuleBase
    implicit: Field
    on_surface: Array
    on_solid: NDArray[np.bool_]
    spacing: Array
    size: float
    finest: float
    levels: NDArray[np.int64]
    offset_points: int


@dataclass(frozen=True)
class Meshed:
    """A mesh in the unit cube.

    Attributes
    ----------
    vertices : (v, 3) float64
    triangles : (t, 3) int32
    confidence : (v,) float64
        Support by the data.
    beyond : (v,) float64
        Distance from the nearest sample, divided by the distance up to which a rim supports the
        surface; 0 where the data support it.
    closing : Closing or None
        What was decided about the holes, unless the user decided.
    watertight : bool
        Whether the mesh is closed.
    """

    vertices: Array
    triangles: NDArray[np.int32]
    confidence: Array
    beyond: Array
    closing: Closing | None
    watertight: bool


@dataclass(frozen=True)
class Local:
    """What Algorithm 2 makes of oriented rules, in the unit cube.

    Attributes
    ----------
    rules, surfaces : RuleBase and LocalSurfaces
        The rules, and their local surfaces.
    inliers, on_surface, facing : (m, 3) float64
        Points that are not outliers, the same moved onto the surface, and their normals.
    """

    rules: RuleBase
    surfaces: LocalSurfaces
    inliers: Array
    on_surface: Array
    facing: Array

    def spacing(self, samples: Samples, on_solid: NDArray[np.bool_]) -> Array:
        """Return the distance between neighbouring samples, (m,), some of them on solids."""
        scale = samples.scale
        usual = scale.spacing[scale.at(self.inliers)]
        return local_spacing(usual, on_solid, self.inliers, samples.tree)


def local_parts(
    learned: Learned, facing: Array, residual: Array, options: Options, clock: Clock
) -> Local:
    """Reconstruct the local surfaces of the rules (Algorithm 2); see :func:`implicit_function`."""
    cloud, samples = learned.cloud, learned.samples
    facing, residual = facing[samples.kept], residual[samples.kept]
    with clock.stage("local surfaces"):
        precision = None if options.precision is None else options.precision / cloud.extent
        inliers = cloud.points if samples.kept.all() else cloud.points[samples.kept]
        rules, surfaces = local_surfaces(learned.rules, inliers, facing, samples.tree, precision)
    return Local(rules, surfaces, inliers, inliers - residual[:, None] * facing, facing)


def implicit_function(
    learned: Learned, facing: Array, residual: Array, options: Options, clock: Clock
) -> Function:
    """Make an implicit function from oriented rules, and choose the cubes it is sampled on.

    Parameters
    ----------
    learned : Learned
        Rules and samples.
    facing, residual : (d, 3) and (d,) float64
        Inferred normals of the distinct points, and their distances from the surface.
    options : Options
        What the user has chosen.
    clock : Clock
        Measures and reports the stages.

    Returns
    -------
    Function

    Raises
    ------
    ValueError
        `voxel_size` asks for more than 500,000 cubes along one side, or for less than one.
    """
    samples, extent = learned.samples, learned.cloud.extent
    local = local_parts(learned, facing, residual, options, clock)
    rules, on_surface, facing = local.rules, local.on_surface, local.facing
    with clock.stage("field"):  # section 4
        scale = samples.scale
        solid, on_solid = solids(rules, on_surface)
        spacing = local.spacing(samples, on_solid)
        # On a sheet cubes may be larger: the winding number does not show how thin it is.
        thick = replace(rules, confidence=np.where(solid, rules.confidence, 1.0))
        wider = np.where(on_solid, 1.0, SHEET)
        size, finest, levels = choose_cubes(
            local.inliers,
            on_surface,
            wider * spacing,
            float(np.median(scale.spacing) * np.median(wider)),
            thick,
            _voxel_size(options, local.inliers, extent),
        )
        edges = finest * np.exp2(levels)
        resolved = np.maximum(spacing, edges)
        far = FarField.of(on_surface, facing, resolved, on_solid)
        implicit = Field(rules, local.surfaces, on_surface, facing, resolved, far)
        spacing = np.maximum(spacing, RESOLVES * edges)
    return Function(
        rules,
        implicit,
        on_surface,
        on_solid,
        spacing,
        size,
        finest,
        levels,
        local.surfaces.offset_points,
    )


def triangulate(function: Function, options: Options, clock: Clock) -> Meshed:
    """Triangulate the zero set, and end it where the user or the data say so.

    Parameters
    ----------
    function : Function
        The function that is zero on the surface.
    options : Options
        What the user has chosen.
    clock : Clock
        Measures and reports the stage.

    Returns
    -------
    Meshed

    Raises
    ------
    ValueError
        No triangle is left.
    """
    implicit = function.implicit
    with clock.stage("surface"):
        vertices, triangles, confidence, closing = mesh(
            implicit,
            function.on_surface,
            function.finest,
            function.levels,
            _border(options, function),
            options.target_triangles,
        )
        as_closed = options.closes is True or (closing is not None and closing.closed)
        watertight = check_mesh(vertices, triangles, closed=as_closed)
        far = np.flatnonzero(confidence == 0.0)
        distance, sample = implicit.nearest(vertices[far], 1)
        beyond = np.zeros(len(vertices))
        beyond[far] = (distance / (VOUCHED * function.spacing[sample]))[:, 0]
    return Meshed(vertices, triangles, confidence, beyond, closing, watertight)


def _voxel_size(options: Options, inliers: Array, extent: float) -> float | None:
    longest = longest_side(inliers)
    if options.depth is not None:
        return float(longest / 2**options.depth)
    if options.voxel_size is None:
        return None
    if options.voxel_size > longest * extent:
        raise ValueError(
            "voxel_size: expected at most the longest side of the points, "
            f"{longest * extent:.6g}, got {options.voxel_size:.6g}"
        )
    return options.voxel_size / extent


def _border(options: Options, function: Function) -> Judge | float | None:
    """Return what ends the surface: a judge of holes, the user's level, or nothing (None)."""
    if options.closes is True:
        return None
    if options.trim is None or options.trim == "auto":
        closes = options.closes == "auto"
        return Judge(function.implicit, function.on_solid, function.spacing, closes)
    return options.trim
