"""Flipped normals on closed meshes, thin parts apart from others: ``python flips.py MESH ...``.

Sides are absolute: nothing is turned by hand. The limit is the same figure for someone who knows
the true surface and takes the normal at its closest point. A point is on a thin part where the next
sheet, straight through the surface or straight in front of it, is nearer than twice the noise and
twice the spacing.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from truth import DENSITIES, Case, draw, parser, read_closed

from o3d_sofnn.geometry.mesh_properties import triangle_areas
from o3d_sofnn.pipeline import estimate_normals

Array = NDArray[Any]

EDGE = -0.02
"""Dot product of the closest surface normal and the true one, below which that one is wrong too."""
OFF = 1e-5
"""Where rays begin in front of the surface, as a fraction of the diagonal."""


class Surface:
    """The true surface, to ask for closest points and for the sheets around them.

    Parameters
    ----------
    vertices, triangles : (v, 3) float64 and (t, 3) int
        A closed mesh wound outwards.
    """

    def __init__(self, vertices: Array, triangles: Array) -> None:
        import open3d as o3d

        self._tensor = o3d.core.Tensor
        self._middle = vertices.mean(axis=0)  # single precision inside
        self._scene = o3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            self._tensor((vertices - self._middle).astype(np.float32)),
            self._tensor(triangles.astype(np.uint32)),
        )
        self.area = float(triangle_areas(vertices, triangles).sum())
        self.diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))

    def closest(self, points: Array) -> tuple[Array, Array]:
        """Return the closest points of the surface and its outward normals there."""
        found = self._scene.compute_closest_points(
            self._tensor((points - self._middle).astype(np.float32))
        )
        return found["points"].numpy() + self._middle, found["primitive_normals"].numpy()

    def holds(self, places: Array) -> NDArray[np.bool_]:
        """Say which places lie inside."""
        found = self._scene.compute_occupancy(
            self._tensor((places - self._middle).astype(np.float32))
        )
        return np.asarray(found.numpy() > 0.5)

    def next_sheet(self, feet: Array, normals: Array) -> Array:
        """Return the distance of the next sheet, behind or in front, of points on the surface."""
        nearest = np.full(len(feet), np.inf)
        for side in (-1.0, 1.0):
            start = feet - self._middle + side * OFF * self.diagonal * normals
            rays = np.concatenate([start, side * normals], axis=1).astype(np.float32)
            hit = self._scene.cast_rays(self._tensor(rays))["t_hit"].numpy()
            nearest = np.minimum(nearest, hit)
        return nearest


def percent(wrong: NDArray[np.bool_]) -> str:
    """Share of True in percent, or a dash where nobody was asked."""
    return f"{100.0 * wrong.mean():.2f}" if len(wrong) else "-"


def main() -> int:
    """Print a line for each cloud, then how often each tenth of the confidence is flipped."""
    found = parser(__doc__)
    found.add_argument("--density", nargs="+", default=DENSITIES[:1], choices=DENSITIES)
    found.add_argument("--outliers", type=float, default=0.0, help="%% of the points")
    options = found.parse_args()
    print("| cloud | flipped, % | limit | thin, % of the points | flipped there | elsewhere |")
    print("|---|---|---|---|---|---|")
    confidence, wrong = [np.zeros(0)], [np.zeros(0, bool)]
    for noise in options.noise:
        for density in options.density:
            shares = []
            for file in options.meshes:
                case = Case(file, options.n, noise, options.outliers, density)
                sure, flipped, limit = report(case)
                confidence.append(sure)
                wrong.append(flipped)
                shares.append((100.0 * flipped.mean(), 100.0 * limit.mean()))
            ours, best = np.mean(shares, axis=0)
            print(f"| mean, {noise:g} %, {density} | {ours:.2f} | {best:.2f} | | | |", flush=True)
    order = np.argsort(np.concatenate(confidence), kind="stable")
    tenths = np.array_split(np.concatenate(wrong)[order], 10)
    print("\nFlipped, % of each tenth of the points, least confident first:")
    print(", ".join(percent(tenth) for tenth in tenths))
    return 0


def report(case: Case) -> tuple[Array, Array, Array]:
    """Print the line of one cloud.

    Parameters
    ----------
    case : Case
        What is drawn.

    Returns
    -------
    confidence, flipped, limit : (m,) float64, bool, bool
        At the inliers: what we say of our sides, whether they are wrong, and whether those of
        someone who knows the surface are.
    """
    cloud, surface = draw(case), Surface(*read_closed(case.file))
    found = estimate_normals(cloud.points)
    points, truth = cloud.points[cloud.inliers], cloud.normals[cloud.inliers]
    flipped = (found.normals[cloud.inliers] * truth).sum(axis=1) <= 0.0
    feet, normals = surface.closest(points)
    limit = (normals * truth).sum(axis=1) < EDGE
    spacing = np.sqrt(surface.area / len(points))
    thinnest = 2.0 * case.noise / 100.0 * surface.diagonal + 2.0 * spacing
    thin = surface.next_sheet(feet, normals) < thinnest
    print(
        f"| {case.file.stem}, {case.noise:g} % | {percent(flipped)} | {percent(limit)} "
        f"| {100.0 * thin.mean():.1f} | {percent(flipped[thin])} | {percent(flipped[~thin])} |",
        flush=True,
    )
    return found.confidence[cloud.inliers], flipped, limit


if __name__ == "__main__":
    sys.exit(main())
