"""Self-check of a mesh against the points it was made from: figures that show a collapse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree, label_pieces, vertex_normals
from o3d_sofnn.geometry.mesh_properties import boundary_edges, triangle_areas
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.threads import thread_count

ASKED = 100_000
"""Largest number of points whose distance from the mesh is measured."""


CRUMB = 24
"""A connected component with fewer points is a crumb, unless it is the largest one."""


MOST_CRUMBS = 20
"""Number of crumbs above which there is a warning: streets and trees have up to 12, clouds with a
grid step as long as the spacing have thousands."""


GRAZING = -0.2
"""Cosine to the viewpoint below which the mesh faces away: rims and edges turn away a little."""


NEAR = 0.8
"""Share of points near the mesh below which there is a warning: it is 0.95 to 1 on objects, at
least 0.85 among trees, and 0.3 where the mesh fell to pieces."""


INVENTED = 0.05
"""Share of invented area of an open mesh above which there is a warning."""


SEEN = 0.9
"""Share of the points where the mesh faces the viewpoint below which there is a warning."""


Array = NDArray[np.float64]


Triangles = NDArray[np.int32]


@dataclass(frozen=True)
class Quality:
    """How well a mesh fits the points that it was made from.

    Attributes
    ----------
    near : float
        Share of the inliers near the mesh: at most one spacing away, or two noise levels if that is
        more.
    invented : float
        Share of the area that is farther than 5 times the spacing from any inlier.
    components, crumbs : int
        Number of connected components, and of components with fewer than 24 inliers.
    border_edges : int
        Number of edges with exactly one triangle.
    border_length : float
        Total length of these edges, in the unit of the points.
    seen : float or None
        Share of the inliers where the mesh does not face away from the viewpoint, if known.
    """

    near: float
    invented: float
    components: int
    crumbs: int
    border_edges: int
    border_length: float
    seen: float | None

    def __str__(self) -> str:
        """One line for a terminal."""
        parts = [
            f"{100.0 * self.near:.1f} % of the points within a spacing",
            f"{100.0 * self.invented:.1f} % of the area invented",
            f"{self.components} component{'' if self.components == 1 else 's'}, "
            f"{self.crumbs} of them crumbs",
        ]
        if self.seen is not None:
            parts.append(f"{100.0 * self.seen:.1f} % face the viewpoint")
        return "; ".join(parts)

    def warnings(self, is_open: bool) -> tuple[str, ...]:
        """Return what looks wrong, and what to try.

        Parameters
        ----------
        is_open : bool
            Whether the mesh was supposed to end where the data end.
        """
        found = []
        if self.near < NEAR:
            found.append(
                f"only {100.0 * self.near:.0f} % of the points are within a spacing of the mesh: "
                "are coordinates rounded, scans out of register, or most points vegetation? Thin "
                "the cloud to even density, or allow larger fits with a larger max_nn or radius"
            )
        if self.crumbs > MOST_CRUMBS:
            found.append(
                f"the mesh has {self.crumbs} crumbs, components with fewer than {CRUMB} points: "
                "are there isolated points or rounded coordinates? Remove outliers or thin the "
                "cloud, or give a larger voxel_size"
            )
        if is_open and self.invented > INVENTED:
            found.append(
                f"{100.0 * self.invented:.0f} % of the area is far from any point: closed=False "
                "leaves all holes open, trim=0.5 cuts at the data"
            )
        if self.seen is not None and self.seen < SEEN:
            found.append(
                f"on {100.0 * (1.0 - self.seen):.0f} % of the points the mesh faces away from the "
                "viewpoint: is that where the scanner stood, in the coordinates of the points?"
            )
        return tuple(found)


@dataclass(frozen=True)
class Inliers:
    """A subset of the inliers of a cloud.

    Attributes
    ----------
    points : (k, 3) float64
        Inliers.
    reach : (k,) float64
        Largest distance from the mesh at which each counts as near.
    directions : (k, 3) float64 or None
        Vectors to where each was seen from.
    weight : float
        Number of inliers that each represents.
    """

    points: Array
    reach: Array
    directions: Array | None
    weight: float

    @classmethod
    def some(cls, points: Array, reach: Array, directions: Array | None) -> Inliers:
        """Return a regular subset of the inliers."""
        few = slice(None, None, 1 + len(points) // ASKED)
        some = points[few].copy()
        seen = None if directions is None else directions[few].copy()
        return cls(some, reach[few].copy(), seen, len(points) / len(some))


def assess(vertices: Array, triangles: Triangles, beyond: Array, inliers: Inliers) -> Quality:
    """Measure how well a mesh fits the inliers.

    Parameters
    ----------
    vertices : (m, 3) float64
    triangles : (t, 3) int32
    beyond : (m,) float64
        Distance of the vertices from the nearest sample, divided by 5 times the spacing.
    inliers : Inliers
        Inliers in the coordinates of the vertices.

    Returns
    -------
    Quality
        The distance of a point is measured to the tangent plane of the nearest vertex, or to the
        vertex itself if all its edges are shorter than the point's distance along that plane.
    """
    facing = np.asarray(vertex_normals(vertices, triangles))
    found = KdTree(vertices, thread_count()).query(inliers.points, 1, np.inf)[1][:, 0]
    step = inliers.points - vertices[found]
    off = np.abs(np.einsum("kd,kd->k", step, facing[found]))
    away = np.linalg.norm(step, axis=1)
    beside = np.sqrt(np.maximum(away**2 - off**2, 0.0))
    distance = np.where(beside <= _longest_edges(vertices, triangles)[found], off, away)
    label = np.asarray(label_pieces(triangles, len(vertices)))
    area = triangle_areas(vertices, triangles)
    count = inliers.weight * np.bincount(label[found], minlength=int(label.max()) + 1)
    border = boundary_edges(triangles)
    length = np.linalg.norm(vertices[border[:, 0]] - vertices[border[:, 1]], axis=1)
    seen = None
    if inliers.directions is not None:
        towards = unit(inliers.directions)
        seen = float((np.einsum("kd,kd->k", towards, facing[found]) > GRAZING).mean())
    return Quality(
        near=float((distance <= inliers.reach).mean()),
        invented=float(area[(beyond > 1.0)[triangles].all(axis=1)].sum() / area.sum()),
        components=len(count),
        crumbs=int((np.sort(count)[:-1] < CRUMB).sum()),
        border_edges=len(border),
        border_length=float(length.sum()),
        seen=seen,
    )


def _longest_edges(vertices: Array, triangles: Triangles) -> Array:
    """Return the length of the longest edge of each vertex, (m,)."""
    start, end = triangles.ravel(), triangles[:, [1, 2, 0]].ravel()
    length = np.linalg.norm(vertices[start] - vertices[end], axis=1)
    longest = np.zeros(len(vertices))
    np.maximum.at(longest, start, length)
    np.maximum.at(longest, end, length)
    return longest
