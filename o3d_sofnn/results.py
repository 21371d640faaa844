"""What the pipeline returns."""

from __future__ import annotations

import dataclasses
import functools
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

if TYPE_CHECKING:
    from o3d_sofnn.geometry.quality import Quality
    from o3d_sofnn.meshing.borders.closing import Closing
    from o3d_sofnn.orientation.evidence import Evidence
    from o3d_sofnn.rules.rule_base import RuleBase


SHOWN = 2
"""Warnings that are shown; the attribute has all of them."""


class Shown(ABC):
    """What a terminal and a notebook show of a result: a few named lines, and its warnings."""

    def __repr__(self) -> str:
        """Return a few lines for a terminal."""
        lines = (f"  {key}: {text}" for key, text in self._lines().items())
        return "\n".join([type(self).__name__, *lines])

    def _repr_html_(self) -> str:
        """Return the same as a table, for notebooks."""
        lines = self._lines().items()
        rows = (f"<tr><th>{escape(key)}</th><td>{escape(text)}</td></tr>" for key, text in lines)
        return f"<table>{''.join(rows)}</table>"

    def _lines(self) -> dict[str, str]:
        told, warnings = self._told()
        lines = {f"warning {i}": text for i, text in enumerate(warnings[:SHOWN], start=1)}
        more = len(warnings) - SHOWN
        return {**told, **lines, **({"and": f"{more} more in .warnings"} if more > 0 else {})}

    @abstractmethod
    def _told(self) -> tuple[dict[str, str], tuple[str, ...]]:
        """Return the lines by name, and all warnings."""


@dataclass(frozen=True, repr=False)
class NormalEstimate(Shown):
    """Oriented normals and what was learned while estimating them.

    Attributes
    ----------
    normals : (n, 3) float64
        Outward unit normals, one per point in the order of the input.
    confidence : (n,) float64
        Confidence in the side of each normal: 1 where the winding number falls by one from behind
        the surface to its front and the rules agree, 0 on open sheets without an outer side.
    outliers : (n,) bool
        Points that took no part in the fits.
    noise : (n,) float64
        Standard deviation of the points from the surface around each point, in their unit.
    noise_level : float
        Median of ``noise``.
    spacing : float
        Median edge of the square of surface that one point covers, in the unit of the points.
    seconds : dict of str to float
        Time of each stage.
    rules : RuleBase
        The rule base, in the coordinates of the points.
    evidence : Evidence
        How the sides of the normals were decided.
    warnings : tuple of str
        What a user should look at.
    """

    normals: NDArray[np.float64]
    confidence: NDArray[np.float64]
    outliers: NDArray[np.bool_]
    noise: NDArray[np.float64]
    noise_level: float
    spacing: float
    seconds: dict[str, float]
    rules: RuleBase
    evidence: Evidence
    warnings: tuple[str, ...]

    def _told(self) -> tuple[dict[str, str], tuple[str, ...]]:
        told = {
            "points": f"{len(self.normals)}, {int(self.outliers.sum())} of them outliers",
            "noise": f"{self.noise_level:.4g} at a spacing of {self.spacing:.4g}",
            "rules": f"{len(self.rules)}",
            "decided": self.evidence.text,
            "time": f"{sum(self.seconds.values()):.2f} s",
        }
        return told, self.warnings


@dataclass(frozen=True, repr=False)
class SurfaceEstimate(Shown):
    """A triangle mesh and what was learned while making it.

    Attributes
    ----------
    vertices : (m, 3) float64
    triangles : (f, 3) int32
        Counter-clockwise as seen from outside.
    vertex_normals : (m, 3) float64
        Unit normals.
    confidence : (m,) float64
        1 where the data supports the surface, 0 where it only closes a hole.
    weigh : callable
        Computes `source_weights`.
    normals : NormalEstimate
        Normals of the points.
    offset_points : int
        Number of off-surface points that the local implicit functions used.
    voxel_size : float
        Edge of a cube of the extraction grid, in the unit of the points.
    seconds : dict of str to float
        Time of each stage, including those of the normals.
    watertight : bool
        Whether every edge belongs to two triangles that run through it in opposite directions.
    closing : Closing or None
        What was closed and why; None if the user chose ``closed=True`` or a level.
    quality : Quality
        Self-check: how well the mesh fits the points.
    """

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int32]
    vertex_normals: NDArray[np.float64]
    confidence: NDArray[np.float64]
    weigh: Callable[[], scipy.sparse.csr_matrix]
    normals: NormalEstimate
    offset_points: int
    voxel_size: float
    seconds: dict[str, float]
    watertight: bool
    closing: Closing | None
    quality: Quality

    def _told(self) -> tuple[dict[str, str], tuple[str, ...]]:
        kind = "closed" if self.watertight else "open"
        told = {
            "mesh": f"{kind}, {len(self.vertices)} vertices, {len(self.triangles)} triangles",
            "quality": str(self.quality),
            **({} if self.closing is None else {"holes": self.closing.reason}),
            "points": f"{len(self.normals.normals)}, noise {self.normals.noise_level:.4g}",
            "decided": self.normals.evidence.text,
            "time": f"{sum(self.seconds.values()):.2f} s",
        }
        return told, self.warnings

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user should look at in the normals and in the mesh."""
        return (*self.normals.warnings, *self.quality.warnings(not self.watertight))

    @cached_property
    def source_weights(self) -> scipy.sparse.csr_matrix:
        """Sparse (m, n) matrix, computed when first asked for; its rows sum to one.

        ``source_weights @ colors`` transfers any attribute of the points to the vertices.
        """
        return self.weigh()


def left_out(finite: NDArray[np.bool_]) -> str:
    """Say how many points are not finite."""
    bad = len(finite) - int(np.count_nonzero(finite))
    return f"{bad} of {len(finite)} points are not finite (NaN or inf) and were left out"


def scatter_normals(estimate: NormalEstimate, finite: NDArray[np.bool_]) -> NormalEstimate:
    """Arrange per-point arrays in the user's rows, including those without finite coordinates.

    Parameters
    ----------
    estimate : NormalEstimate
        The result for the f finite points.
    finite : (n,) bool
        Which of the user's points are finite. The others get the normal (0, 0, 0), the confidence
        0 and the noise NaN, count as outliers, and are mentioned in a warning.
    """
    if finite.all():
        return estimate

    def spread(values: NDArray[Any], missing: Any) -> NDArray[Any]:
        full = np.full((len(finite), *values.shape[1:]), missing, dtype=values.dtype)
        full[finite] = values
        return full

    return dataclasses.replace(
        estimate,
        normals=spread(estimate.normals, 0.0),
        confidence=spread(estimate.confidence, 0.0),
        outliers=spread(estimate.outliers, True),
        noise=spread(estimate.noise, np.nan),
        warnings=(*estimate.warnings, left_out(finite)),
    )


def scatter_surface(estimate: SurfaceEstimate, finite: NDArray[np.bool_]) -> SurfaceEstimate:
    """Do the same for the normals and the weights of a surface."""
    if finite.all():
        return estimate
    return dataclasses.replace(
        estimate,
        normals=scatter_normals(estimate.normals, finite),
        weigh=functools.partial(_scatter_weights, estimate.weigh, finite),
    )


def _scatter_weights(
    weigh: Callable[[], scipy.sparse.csr_matrix], finite: NDArray[np.bool_]
) -> scipy.sparse.csr_matrix:
    weights = weigh()
    return scipy.sparse.csr_matrix(
        (weights.data, np.flatnonzero(finite)[weights.indices], weights.indptr),
        shape=(weights.shape[0], len(finite)),
    )
