"""Local fits: one weighted quadric around each centre (Algorithm 1, steps 3 and 5)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn._kernels import fit_quadrics as native_fit_quadrics
from o3d_sofnn.geometry.vectors import unit

if TYPE_CHECKING:
    from typing_extensions import Self

RADIUS = 1.1
"""Radius of a fit, divided by the distance of its last neighbour (as in the native kernel)."""


RULES_PER_NEIGHBORHOOD = 8.0
"""Number of rule centres in the neighbourhood of one fit, which sets the overlap of the fits."""


ROBUST = 2.0
"""Width of the residual weight in the second fit, divided by the noise level."""

NEAREST = 6
"""Number of nearest points that decide the side of a typical datum."""


@dataclass(frozen=True)
class Quadrics:
    """Quadrics fitted to elliptical neighbourhoods.

    In the frame of fit ``j``, with lengths divided by its radius, the surface is
    ``h = c0 + c1 u + c2 v + c3 u^2 + c4 u v + c5 v^2``, and the neighbourhood with the stretch
    ``s`` is bounded by ``s u^2 + v^2 / s = 1``.

    Attributes
    ----------
    centers : (r, 3) float64
        Origins of the frames, in the unit of the points.
    frames : (r, 3, 3) float64
        Rows: two tangents and the normal of the fitted plane.
    coefficients : (r, 6) float64
        Coefficients of the quadrics, dimensionless.
    radius : (r,) float64
        Radius of the fitted neighbourhood.
    stretch : (r,) float64
        Length of the neighbourhood divided by its width.
    residual : (r,) float64
        Root-mean-square residual of the fit.
    support : (r,) float64
        Share of the neighbourhood that faces the side of the fit, 0 to 1.
    n_neighbors : (r,) int64
        Number of points in the fit.
    """

    centers: NDArray[np.float64]
    frames: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    radius: NDArray[np.float64]
    stretch: NDArray[np.float64]
    residual: NDArray[np.float64]
    support: NDArray[np.float64]
    n_neighbors: NDArray[np.int64]

    def __len__(self) -> int:
        """Return the number of fits."""
        return len(self.centers)

    @property
    def feet(self) -> NDArray[np.float64]:
        """Centres, moved onto their quadrics, (r, 3)."""
        height = self.radius * self.coefficients[:, 0]
        return self.centers + height[:, None] * self.frames[:, 2]

    @property
    def normals(self) -> NDArray[np.float64]:
        """Unit normals of the quadrics at the feet, (r, 3)."""
        c = self.coefficients
        n = self.frames[:, 2] - c[:, 1:2] * self.frames[:, 0] - c[:, 2:3] * self.frames[:, 1]
        return unit(n)

    @property
    def curvatures(self) -> NDArray[np.float64]:
        """Principal curvatures at the feet, (r, 2), smaller first, positive where convex."""
        c = self.coefficients / self.radius[:, None]
        mean = -(c[:, 3] + c[:, 5])
        spread = np.hypot(c[:, 3] - c[:, 5], c[:, 4])
        return np.stack([mean - spread, mean + spread], axis=1)

    def facing(self, side: NDArray[np.float64]) -> Self:
        """Flip every quadric whose normal has a negative dot product with its row of `side`."""
        sign = np.where(np.einsum("rd,rd->r", self.normals, side) < 0, -1.0, 1.0)
        frames = self.frames * np.stack([np.ones_like(sign), sign, sign], axis=1)[:, :, None]
        flip = np.array([-1.0, -1.0, 1.0, -1.0, 1.0, -1.0])
        coefficients = np.where(sign[:, None] < 0, self.coefficients * flip, self.coefficients)
        return replace(self, frames=frames, coefficients=coefficients)

    def raised(self, height: NDArray[np.float64]) -> Self:
        """Move each consequent along the normal of its frame by (r,) heights."""
        coefficients = self.coefficients.copy()
        coefficients[:, 0] += height / self.radius
        return replace(self, coefficients=coefficients)


@dataclass(frozen=True)
class Neighborhoods:
    """Where to fit, and to which points.

    Attributes
    ----------
    centers : (r, 3) float64
        Centres of the fits.
    sides : (r, 3) float64
        Unit normals that the fits face.
    n_neighbors : (r,) int64
        Number of points in each fit.
    noise : (r,) float64
        Noise level at each centre.
    across : (r, 3) float64, optional
        Tangents along which the neighbourhoods are narrow; arbitrary where they are round.
    stretch : (r,) float64, optional
        Length divided by width, at the same area. The neighbourhoods are round if not given.
    """

    centers: NDArray[np.float64]
    sides: NDArray[np.float64]
    n_neighbors: NDArray[np.int64]
    noise: NDArray[np.float64]
    across: NDArray[np.float64] | None = None
    stretch: NDArray[np.float64] | None = None


def fit_quadrics(
    tree: KdTree,
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    where: Neighborhoods,
) -> Quadrics:
    """Fit one quadric around each centre (Algorithm 1, steps 3 and 5).

    Parameters
    ----------
    tree : KdTree
        Tree of `points`.
    points, normals : (n, 3) float64
        Distinct points and their oriented normals. A point is weighted by the squared cosine
        between its normal and the side of the fit, and left out if it faces the other way: the
        two sides of a thin sheet and the two faces of an edge are kept apart.
    where : Neighborhoods
        The r fits to make.

    Returns
    -------
    Quadrics
        Fits that face the given sides.
    """
    stretch = np.ones(len(where.centers)) if where.stretch is None else where.stretch
    frames, coefficients, residual, radius, support = native_fit_quadrics(
        tree,
        points,
        where.centers,
        where.n_neighbors,
        ROBUST * where.noise,
        3,
        normals,
        where.sides,
        where.across,
        stretch,
    )
    quadrics = Quadrics(
        centers=where.centers,
        frames=np.asarray(frames),
        coefficients=np.asarray(coefficients),
        radius=np.maximum(radius, 1e-300),
        stretch=stretch,
        residual=np.asarray(residual),
        support=np.asarray(support),
        n_neighbors=where.n_neighbors,
    )
    return quadrics.facing(where.sides)


def sides_around(
    x: NDArray[np.float64],
    facing: NDArray[np.float64],
    normals: NDArray[np.float64],
    tree: KdTree,
) -> NDArray[np.float64]:
    """Average the normals of the nearest points that face the same way, or of all if none does.

    Parameters
    ----------
    x, facing : (m, 3) float64
        Queries, and the directions that they face.
    normals : (n, 3) float64
        Unit normals of the points.
    tree : KdTree
        Tree of the points.

    Returns
    -------
    (m, 3) float64
        Unit normals.
    """
    distance, index = tree.query(x, min(NEAREST, len(normals)), np.inf)
    around = normals[index]
    same = np.maximum(np.einsum("mkd,md->mk", around, facing), 1e-6)
    width = np.maximum(distance[:, 1 % distance.shape[1]], 1e-300)[:, None]
    sides = np.einsum("mk,mkd->md", same * np.exp(-((distance / width) ** 2)), around)
    return unit(sides)


def spacing_of(radius: NDArray[np.float64], n_neighbors: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the edge of the square that one point covers, from radius and size of (p,) fits."""
    return np.asarray(radius / RADIUS * np.sqrt(np.pi / n_neighbors))
