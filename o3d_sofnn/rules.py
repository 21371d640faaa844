"""Stages 3 and 4: the rule base. Typical data, one local fit each, growth where the fits fail."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from . import _kernels
from .experience import Experience
from .local_fit import RADIUS, Scale
from .octree import build_octree
from .vectors import unit

NEAREST = 6
"""Points that give a typical datum its side."""
LEAF = 32
"""Fewest points in an octree leaf, the piece of data that one fuzzy c-means run sees."""
RULES_PER_NEIGHBORHOOD = 8.0
"""Rules whose centres lie in the neighbourhood of one fit: how far neighbouring fits overlap."""
NOISE_TOLERANCE = 1.4
"""Width of the membership in the residual, over the noise level."""
SHAPE_TOLERANCE = 0.02
"""The same over the radius of the fit: what a quadric leaves of a clean shape."""
ROBUST = 2.0
"""Width of the residual weight in the second fit, over the noise level."""
UNCERTAIN = 3.0
"""Curvature that noise may cause, over noise / radius / sqrt(points of the fit)."""
FLAT = 0.02
"""Curvature times radius that is none."""
LONGEST = 2.0
"""Largest stretch of a neighbourhood."""


@dataclass(frozen=True)
class RuleBase:
    """Rules: an elliptical region of space each, with a quadric as its consequent.

    In the frame of rule ``j`` with lengths over its radius, the surface is
    ``h = c0 + c1 u + c2 v + c3 u^2 + c4 u v + c5 v^2``, and the region is bounded by
    ``s u^2 + v^2 / s = 1`` with its stretch ``s``.

    Attributes
    ----------
    centers : (r, 3) float64
        Origins of the frames, in the unit of the points.
    frames : (r, 3, 3) float64
        Rows: two tangents and the normal of the fitted plane.
    coefficients : (r, 6) float64
        Consequent quadric, dimensionless.
    radius : (r,) float64
        Radius of the fitted neighbourhood; the tangential width is half of it.
    stretch : (r,) float64
        How many times longer than wide the neighbourhood is.
    residual : (r,) float64
        Root-mean-square residual of the fit.
    support : (r,) float64
        Share of the neighbourhood that faces the side of the rule, 0 to 1.
    noise : (r,) float64
        Noise level of the region.
    n_neighbors : (r,) int64
        Points that the fit saw.
    confidence : (r,) float64
        Confidence in the side that the normal faces, 0 to 1.
    """

    centers: NDArray[np.float64]
    frames: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    radius: NDArray[np.float64]
    stretch: NDArray[np.float64]
    residual: NDArray[np.float64]
    support: NDArray[np.float64]
    noise: NDArray[np.float64]
    n_neighbors: NDArray[np.int64]
    confidence: NDArray[np.float64]

    def __len__(self) -> int:
        """Return the number of rules."""
        return len(self.centers)

    @property
    def feet(self) -> NDArray[np.float64]:
        """Centres moved onto their quadrics, (r, 3)."""
        height = self.radius * self.coefficients[:, 0]
        return self.centers + height[:, None] * self.frames[:, 2]

    @property
    def normals(self) -> NDArray[np.float64]:
        """Unit normals of the quadrics at the feet, (r, 3)."""
        c = self.coefficients
        n = self.frames[:, 2] - c[:, 1:2] * self.frames[:, 0] - c[:, 2:3] * self.frames[:, 1]
        return np.asarray(n / np.linalg.norm(n, axis=1, keepdims=True))

    @property
    def curvatures(self) -> NDArray[np.float64]:
        """Principal curvatures at the feet, (r, 2), smaller first, positive where convex."""
        c = self.coefficients / self.radius[:, None]
        mean = -(c[:, 3] + c[:, 5])
        spread = np.hypot(c[:, 3] - c[:, 5], c[:, 4])
        return np.stack([mean - spread, mean + spread], axis=1)

    @property
    def areas(self) -> NDArray[np.float64]:
        """Area of surface that each rule stands for, (r,)."""
        return np.asarray(np.pi * (self.radius / RADIUS) ** 2 / RULES_PER_NEIGHBORHOOD)

    @property
    def tolerance(self) -> NDArray[np.float64]:
        """Width of the membership in the residual, (r,), in the unit of the points."""
        return np.maximum(NOISE_TOLERANCE * self.noise, SHAPE_TOLERANCE * self.radius)

    @property
    def quality(self) -> NDArray[np.float64]:
        """Weight of each rule in the inference: low where the quadric does not fit, (r,)."""
        return np.asarray(np.exp(-0.5 * np.minimum(self.residual / self.tolerance, 30.0) ** 2))

    @property
    def ellipses(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Direction of strongest curvature, (r, 3), and stretch along the other one, (r,)."""
        c = self.coefficients
        half = 0.5 * np.arctan2(c[:, 4], c[:, 3] - c[:, 5])
        mean, spread = c[:, 3] + c[:, 5], np.hypot(c[:, 3] - c[:, 5], c[:, 4])
        half = np.where(mean < 0.0, half + 0.5 * np.pi, half)
        across = (
            np.cos(half)[:, None] * self.frames[:, 0] + np.sin(half)[:, None] * self.frames[:, 1]
        )
        # A curvature that noise alone may cause says nothing about the direction.
        floor = UNCERTAIN * self.noise / self.radius / np.sqrt(self.n_neighbors) + FLAT
        strong, weak = 0.5 * (np.abs(mean) + spread), 0.5 * np.abs(np.abs(mean) - spread)
        return across, np.clip(((strong + floor) / (weak + floor)) ** 0.5, 1.0, LONGEST)

    def facing(self, side: NDArray[np.float64]) -> RuleBase:
        """Turn every rule whose normal has a negative product with its row of `side`."""
        sign = np.where(np.einsum("rd,rd->r", self.normals, side) < 0, -1.0, 1.0)
        frames = self.frames * np.stack([np.ones_like(sign), sign, sign], axis=1)[:, :, None]
        flip = np.array([-1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
        coefficients = np.where(sign[:, None] < 0, self.coefficients * flip, self.coefficients)
        return replace(self, frames=frames, coefficients=coefficients)

    def raised(self, height: NDArray[np.float64]) -> RuleBase:
        """Move each consequent along the normal of its frame, (r,) heights."""
        coefficients = self.coefficients.copy()
        coefficients[:, 0] += height / self.radius
        return replace(self, coefficients=coefficients)

    def moved(self, scale: float, offset: NDArray[np.float64]) -> RuleBase:
        """Return the rules in coordinates ``scale * x + offset``."""
        return replace(
            self,
            centers=scale * self.centers + offset,
            radius=scale * self.radius,
            residual=scale * self.residual,
            noise=scale * self.noise,
        )

    def view(self, n_threads: int, experience: Experience | None = None) -> _kernels.RuleView:
        """Copy the rules, and what experience says of them, for the native kernels."""
        gates = None if experience is None else experience.gates(self)
        return _kernels.RuleView(
            self.centers,
            np.ascontiguousarray(self.frames),
            np.ascontiguousarray(self.coefficients),
            self.radius,
            self.stretch,
            self.tolerance,
            self.quality,
            gates,
            None if experience is None else experience.neurons,
            n_threads,
        )

    def rows(self, index: NDArray[np.bool_]) -> RuleBase:
        """Pick some of the rules."""
        return RuleBase(**{name: value[index] for name, value in vars(self).items()})

    def joined(self, other: RuleBase) -> RuleBase:
        """Both rule bases, this one first."""
        return RuleBase(
            *(np.concatenate([vars(self)[name], vars(other)[name]]) for name in vars(self))
        )


def typical_data(
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    tree: _kernels.KdTree,
    scale: Scale,
    n_threads: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draw the typical data of the cloud: fuzzy c-means in every octree leaf (section 3.1).

    A leaf that holds both sides of a thin part is divided: a typical datum of both would lie
    between them.

    Parameters
    ----------
    points, normals : (n, 3) float64
        Distinct points and on which side of the surface they lie.
    tree : KdTree
        Over `points`.
    scale : Scale
        Its neighbourhood size says how many points one typical datum stands for.
    n_threads : int
        Threads.

    Returns
    -------
    centers : (c, 3) float64
        Cluster centres, c << n where there is noise.
    sides : (c, 3) float64
        Unit normals there.
    """
    # Leaves smaller than a neighbourhood would get one rule each, however far they overlap.
    leaves = build_octree(points, max(LEAF, int(np.median(scale.n_neighbors)) // 4))
    order, offsets, facing = divide_by_side(normals[leaves.order], leaves.offsets, n_threads)
    x = np.ascontiguousarray(leaves.points[order])
    count = np.diff(offsets)
    middle = x[(offsets[:-1] + offsets[1:]) // 2]
    neighbors = scale.n_neighbors[scale.at(middle, n_threads)]
    clusters = np.clip(np.rint(count * RULES_PER_NEIGHBORHOOD / neighbors), 1, count)
    clusters = clusters.astype(np.int64)
    centers = np.asarray(_kernels.typical_data(x, offsets, clusters, 8, 1e-2, n_threads))
    facing = np.repeat(facing, clusters, axis=0)
    return centers, sides_around(centers, facing, normals, tree, n_threads)


def sides_around(
    x: NDArray[np.float64],
    facing: NDArray[np.float64],
    normals: NDArray[np.float64],
    tree: _kernels.KdTree,
    n_threads: int,
) -> NDArray[np.float64]:
    """Mean normal of the nearest points that face the same way, or of all where none does.

    Parameters
    ----------
    x, facing : (m, 3) float64
        Places and which way they face.
    normals : (n, 3) float64
        Unit normals of the points.
    tree : KdTree
        Over the points.
    n_threads : int
        Threads.

    Returns
    -------
    (m, 3) float64
        Unit normals.
    """
    distance, index = tree.query(x, min(NEAREST, len(normals)), np.inf, n_threads)
    around = normals[index]
    same = np.maximum(np.einsum("mkd,md->mk", around, facing), 1e-6)
    width = np.maximum(distance[:, 1 % distance.shape[1]], 1e-300)[:, None]
    sides = np.einsum("mk,mkd->md", same * np.exp(-((distance / width) ** 2)), around)
    return unit(sides)


def divide_by_side(
    normals: NDArray[np.float64], offsets: NDArray[np.int64], n_threads: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Divide cells whose normals face both ways along their main axis.

    Parameters
    ----------
    normals : (n, 3) float64
        Unit normals, cell by cell.
    offsets : (c + 1,) int64
        Cell ``i`` holds rows ``offsets[i]`` to ``offsets[i + 1]``.
    n_threads : int
        Threads.

    Returns
    -------
    order : (n,) int64
        Rows, part by part.
    offsets : (p + 1,) int64
        The same for the parts.
    facing : (p, 3) float64
        Mean normal of each part.
    """
    order, size = map(np.asarray, _kernels.divide_cells(normals, offsets, n_threads))
    starts = np.stack([offsets[:-1], offsets[:-1] + size], axis=1)
    first = np.append(starts, len(normals))
    first = first[:-1][np.diff(first) > 0]
    facing = np.add.reduceat(normals[order], first)
    return order, np.append(first, len(normals)), facing


def fit_rules(
    points: NDArray[np.float64],
    tree: _kernels.KdTree,
    centers: NDArray[np.float64],
    n_neighbors: NDArray[np.int64],
    noise: NDArray[np.float64],
    n_threads: int,
    *,
    normals: NDArray[np.float64] | None = None,
    sides: NDArray[np.float64] | None = None,
    confidence: NDArray[np.float64] | None = None,
    across: NDArray[np.float64] | None = None,
    stretch: NDArray[np.float64] | None = None,
) -> RuleBase:
    """Fit one quadric around each centre (Algorithm 1, steps 3 and 5).

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points.
    tree : KdTree
        Over `points`.
    centers : (r, 3) float64
        Where the fits are made.
    n_neighbors : (r,) int64
        Points in each fit.
    noise : (r,) float64
        Noise level at each centre.
    n_threads : int
        Threads.
    normals, sides : (n, 3) and (r, 3) float64, optional
        Oriented normals of the points and of the rules. With them a point enters a fit by the
        square of the cosine between its normal and the rule's, and not at all when it faces the
        other way: the two sides of a thin sheet and the two faces of an edge are kept apart.
    confidence : (r,) float64, optional
        Of the sides, kept with the rules; 1 when not given.
    across, stretch : (r, 3) and (r,) float64, optional
        Tangents along which the neighbourhoods are narrow, and how many times longer than wide
        they are, at the same area. Round when not given.

    Returns
    -------
    RuleBase
    """
    stretch = np.ones(len(centers)) if stretch is None else stretch
    robust = ROBUST * noise if normals is not None else np.zeros(len(centers))
    _, frames, coefficients, info = _kernels.fit_rules(
        tree, points, centers, n_neighbors, robust, 3, normals, sides, across, stretch, n_threads
    )
    rules = RuleBase(
        centers,
        np.asarray(frames),
        np.asarray(coefficients),
        np.maximum(info[:, 2], 1e-300),
        stretch,
        np.asarray(info[:, 0]),
        np.asarray(info[:, 4]),
        noise,
        n_neighbors,
        np.ones(len(centers)) if confidence is None else confidence,
    )
    return rules if sides is None else rules.facing(sides)


def infer_normals(
    rules: RuleBase,
    x: NDArray[np.float64],
    n_threads: int,
    *,
    sides: NDArray[np.float64] | None = None,
    k: int = 12,
    experience: Experience | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Infer a normal at every point, eq. (7) and (9).

    The membership of a point in a rule is the product of a Gaussian in the tangent plane, a
    Gaussian in the residual to the quadric, and the rule's quality, so that a point takes its
    normal from the face of an edge or the side of a sheet it lies on.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    x : (n, 3) float64
        Where the normal is wanted.
    n_threads : int
        Threads.
    sides : (n, 3) float64, optional
        Unit vectors out of the surface at each place, as far as they are known; (0, 0, 0) where
        they are not. A Gaussian in the angle to the normal of the rule joins the membership: on
        parts hardly thicker than the noise the residual alone does not tell the sides apart.
    k : int, default 12
        Nearest rules that take part.
    experience : Experience, optional
        Off-line rules: the trust that they put in a rule at a place joins the membership.

    Returns
    -------
    normals : (n, 3) float64
        Unit normals.
    agreement : (n,) float64
        Length of the mean normal of the rules that took part, 0 to 1.
    residual : (n,) float64
        Signed distance to the quadric of the rule with the largest membership.
    """
    view = rules.view(n_threads, experience)
    normals, info = _kernels.infer_normals(view, x, sides, min(k, len(rules)), n_threads)
    return np.asarray(normals), np.asarray(info[:, 0]), np.asarray(info[:, 1])
