"""Stage 7: reconstruct local progressive surfaces (Algorithm 2, RLPS)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn._kernels import reconstruct_units as native_reconstruct_units
from o3d_sofnn.rules.inference import infer_normals
from o3d_sofnn.rules.rule_base import RuleBase, fit_rules, joined
from o3d_sofnn.sampling.local_fit import Neighborhoods

NOISE_PRECISION = (4.0, 6.0)
"""Precision epsilon divided by the noise level, where that level is mostly shape that the quadrics
miss, and where it is noise: smaller residuals do not count as shape."""


SHAPE_PRECISION = 1e-3
"""Smallest precision, divided by the radius of a unit."""


@dataclass(frozen=True)
class LocalSurfaces:
    """One local implicit per unit: the quadric of its rule, corrected by radial basis functions.

    Attributes
    ----------
    terms : (r, t, 4) float64
        Centre, in the frame of the rule and divided by its radius, and weight of each function.
    n_terms : (r,) int64
        Number of terms in use.
    error : (r,) float64
        Largest remaining residual at a point of the unit, in the unit of the points.
    worst : (r, 3) float64
        The point with that residual.
    precision : (r,) float64
        Epsilon of each unit.
    """

    terms: NDArray[np.float64]
    n_terms: NDArray[np.int64]
    error: NDArray[np.float64]
    worst: NDArray[np.float64]
    precision: NDArray[np.float64]

    @property
    def unresolved(self) -> NDArray[np.bool_]:
        """Mask of units whose residual exceeds the precision, for step 3 of Algorithm 2."""
        return self.error > self.precision

    @property
    def offset_points(self) -> int:
        """Number of off-surface points: one for each unit that needed centres."""
        return int((self.n_terms > 0).sum())

    def joined(self, other: LocalSurfaces) -> LocalSurfaces:
        """Return both sets of units, this one first."""
        return joined(self, other)


SMALLEST = 8
"""Smallest number of points in a unit."""


def local_surfaces(
    rules: RuleBase,
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    tree: KdTree,
    precision: float | None = None,
) -> tuple[RuleBase, LocalSurfaces]:
    """Reconstruct all units, and divide those that miss the precision (Algorithm 2, step 3).

    A unit of half as many points is placed where the residual of its parent is largest; the parent
    is kept with the lower weight that follows from its residual.

    Parameters
    ----------
    rules, points, normals, tree, precision
        As in :func:`reconstruct_units`.

    Returns
    -------
    rules : RuleBase
        The rules, followed by those of the new units.
    surfaces : LocalSurfaces
        One per rule.
    """
    surfaces = reconstruct_units(rules, points, normals, tree, precision)
    divide = np.flatnonzero(surfaces.unresolved & (rules.n_neighbors >= 2 * SMALLEST))
    if not len(divide):
        return rules, surfaces
    centers = surfaces.worst[divide]
    where = Neighborhoods(
        centers=centers,
        sides=infer_normals(rules, centers)[0],
        n_neighbors=rules.n_neighbors[divide] // 2,
        noise=rules.noise[divide],
    )
    children = fit_rules(tree, points, normals, where, rules.confidence[divide])
    finer = reconstruct_units(children, points, normals, tree, precision)
    return rules.joined(children), surfaces.joined(finer)


def reconstruct_units(
    rules: RuleBase,
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    tree: KdTree,
    precision: float | None = None,
) -> LocalSurfaces:
    """Refine the local surface of every rule until it fits its points.

    The rough set starts with the point whose residual to the quadric is largest, and with one
    off-surface point per unit, above its middle, where the quadric's distance is kept. While the
    largest residual exceeds the precision and the set is small enough, the point with that residual
    is appended and the function is computed again. Points of other faces bound the surface: at an
    edge it may not cut them off.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules, one per unit.
    points, normals : (n, 3) float64
        Distinct points and their oriented normals: only points on the side of the unit count.
    tree : KdTree
        Tree of `points`.
    precision : float, optional
        Epsilon of all units, in the unit of `points`. The nearer half of the points, which have
        most of the weight in the fit, decides whether a unit is refined: the others are closer to
        other units. None derives the limit from the noise, at least a small part of the radius, and
        lets all points of a unit decide: the overlap improves the accuracy, but needs two to four
        times as many off-surface points.

    Returns
    -------
    LocalSurfaces
    """
    if precision is None:
        clean, noisy = NOISE_PRECISION
        factor = clean + (noisy - clean) * rules.noisiness
        limit = np.maximum(factor * rules.noise, SHAPE_PRECISION * rules.radius)
        own = rules.n_neighbors
    else:
        limit = np.full(len(rules.radius), precision)
        own = (rules.n_neighbors + 1) // 2
    terms, n_terms, error, worst = native_reconstruct_units(
        tree,
        points,
        normals,
        rules.plain_view,
        rules.n_neighbors,
        own,
        limit,
    )
    return LocalSurfaces(
        np.asarray(terms),
        np.asarray(n_terms),
        np.asarray(error),
        np.asarray(worst),
        limit,
    )
