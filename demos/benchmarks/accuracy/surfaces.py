"""Meshes from samples of closed shapes beside Open3D's Poisson: ``python surfaces.py MESH ...``.

Ours starts from the points alone. The *oracle* is Poisson that was given the true normals, the
*chain* what people type: normals (30 neighbours), tangent-plane orientation, Poisson; both at depth
9. Chamfer and Hausdorff are distances of points from the other surface, in 1/1000 of the diagonal.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from truth import DENSITIES, Case, Cloud, draw, parser, read_closed

from o3d_sofnn.compare.measure import Truth, figures
from o3d_sofnn.compare.peers import Mesh
from o3d_sofnn.pipeline import reconstruct_surface

Array = NDArray[Any]

DEPTH, NEIGHBORS = 9, 30
"""Of the peers."""
PROBES = 100_000
"""Points on each surface from which distances are taken."""


def ours(cloud: Cloud) -> Mesh:
    """Reconstruct from the points alone."""
    found = reconstruct_surface(cloud.points)
    return Mesh(found.vertices, found.triangles.astype(np.int64), None)


def oracle(cloud: Cloud) -> Mesh:
    """Reconstruct with Poisson from the true normals; outliers have none and are left out."""
    return _poisson(cloud.points[cloud.inliers], cloud.normals[cloud.inliers])


def chain(cloud: Cloud) -> Mesh:
    """Reconstruct with Poisson from normals that Open3D has estimated and oriented."""
    return _poisson(cloud.points, None)


def _poisson(points: Array, normals: Array | None) -> Mesh:
    import open3d as o3d

    pcd = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    if normals is None:
        pcd.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NEIGHBORS))
        pcd.orient_normals_consistent_tangent_plane(NEIGHBORS)
    else:
        pcd.normals = o3d.utility.Vector3dVector(normals)
    mesh = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(pcd, depth=DEPTH)[0]
    triangles = np.asarray(mesh.triangles).astype(np.int64)
    return Mesh(np.asarray(mesh.vertices), triangles, None)


METHODS: dict[str, Callable[[Cloud], Mesh]] = {"ours": ours, "oracle": oracle, "chain": chain}


def measure(case: Case, methods: list[str]) -> dict[str, dict[str, float]]:
    """Return the figures of each method on one cloud."""
    cloud, truth = draw(case), read_closed(case.file)
    found = {}
    for method in methods:
        started = time.process_time()
        mesh = METHODS[method](cloud)
        seconds = time.process_time() - started
        kept = Truth(*truth, cloud.normals[cloud.inliers])
        found[method] = figures(cloud.points[cloud.inliers], mesh, kept, PROBES)
        found[method]["seconds"] = seconds
    return found


def main() -> int:
    """Print a table of all cases and a row of medians."""
    options = parser(__doc__, 20_000, (0.0,))
    options.add_argument("--density", choices=DENSITIES, default="uniform")
    options.add_argument("--outliers", type=float, default=0.0, help="in %% of the points")
    options.add_argument("--peer", choices=["oracle", "chain"], default="oracle")
    given = options.parse_args()
    peer = given.peer
    for noise in given.noise:
        print(
            f"\n{given.n} samples, {noise:g} % noise, {given.density}, "
            f"{given.outliers:g} % outliers"
        )
        print(
            f"| shape | Chamfer, ours / {peer} | Hausdorff, ours / {peer} | CPU seconds | "
            "triangles | closed, manifold | pieces |\n|" + "---|" * 7
        )
        ratios = []
        for file in given.meshes:
            case = Case(file, given.n, noise, given.outliers, given.density)
            row = measure(case, ["ours", peer])
            mine, other = row["ours"], row[peer]
            keys = ("chamfer", "hausdorff", "seconds", "triangles")
            ratios.append([mine[key] / other[key] for key in keys])
            (a, b, c, d), sound = ratios[-1], mine["watertight"] and mine["manifold"]
            print(
                f"| {file.stem} | {mine['chamfer']:.3f} / {other['chamfer']:.3f} ({a:.2f}) | "
                f"{mine['hausdorff']:.1f} / {other['hausdorff']:.1f} ({b:.2f}) | "
                f"{mine['seconds']:.1f} ({c:.2f}) | {mine['triangles']:.0f} ({d:.2f}) | "
                f"{'yes' if sound else 'no'} | {mine['components']:.0f} |",
                flush=True,
            )
        a, b, c, d = np.median(ratios, axis=0)
        print(f"| **median** | **{a:.2f}** | **{b:.2f}** | **{c:.2f}** | **{d:.2f}** | | |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
