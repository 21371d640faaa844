"""Error of normals on closed meshes, beside the best fixed fits: ``python normals.py MESH ...``.

Angles are against the face a point was drawn from, either side. "Best k" is the quadric fit with
the best fixed number of neighbours, chosen with knowledge of the truth for every cloud; "plane" is
Open3D's ``estimate_normals`` with 30 neighbours.
"""

from __future__ import annotations

import sys

import numpy as np
from truth import DENSITIES, Case, Cloud, draw, parser

from o3d_sofnn._kernels import KdTree, fit_scales
from o3d_sofnn.pipeline import estimate_normals

SIZES = np.array([12, 18, 27, 40, 60, 90, 135, 200, 300])
"""Numbers of neighbours of which the best one is taken."""
PLACES = 20_000
"""Points of a cloud at which they are tried."""


def main() -> int:
    """Print a line for each cloud."""
    found = parser(__doc__)
    found.add_argument("--density", default="uniform", choices=DENSITIES)
    found.add_argument("--outliers", type=float, nargs="+", default=[0.0], help="%% of the points")
    options = found.parse_args()
    print("| cloud | ours | best k | over best k | plane | within 10° | flipped | outliers: F1 |")
    print("|---|---|---|---|---|---|---|---|")
    for noise in options.noise:
        for outliers in options.outliers:
            ratios = []
            for file in options.meshes:
                case = Case(file, options.n, noise, outliers, options.density)
                ratios.append(report(case))
            print(f"| mean, noise {noise:g}, outliers {outliers:g} | | | {np.mean(ratios):.3f} |")
    return 0


def report(case: Case) -> float:
    """Print the line of one cloud and return our error over that of the best fixed fit.

    With outliers that fit is replaced by ourselves on the same cloud without them.
    """
    cloud = draw(case)
    found = estimate_normals(cloud.points)
    ours, angles = cloud.error(found.normals), cloud.angles(found.normals)
    cosine = (found.normals * cloud.normals).sum(axis=1)[cloud.inliers]
    f1 = ""
    if case.outliers:
        clean = cloud.points[cloud.inliers]
        alone = Cloud(clean, cloud.normals[cloud.inliers], np.ones(len(clean), bool))
        size, best = "alone", alone.error(estimate_normals(clean).normals)
        plane = alone.error(planes(alone))
        right = (found.outliers & ~cloud.inliers).sum()
        f1 = f"{2 * right / (found.outliers.sum() + (~cloud.inliers).sum()):.3f}"
    else:
        size, best = best_fit(cloud)
        plane = cloud.error(planes(cloud))
    name = f"{case.file.stem}, {case.noise:g} %"
    name += f", {case.outliers:g} % outliers" if case.outliers else ""
    print(
        f"| {name} | {ours:.2f} | {best:.2f} ({size}) | {ours / best:.3f} | {plane:.2f} "
        f"| {(angles < 10.0).mean():.3f} | {100 * (cosine < 0.0).mean():.2f} % | {f1} |",
        flush=True,
    )
    return ours / best


def best_fit(cloud: Cloud) -> tuple[str, float]:
    """Return the best fixed number of neighbours and the error of quadric fits to so many."""
    row = np.arange(len(cloud.points))
    if len(row) > PLACES:
        row = np.random.default_rng(0).choice(len(row), PLACES, replace=False)
    places = np.ascontiguousarray(cloud.points[row])
    some = Cloud(places, cloud.normals[row], np.ones(len(row), bool))
    normals = fit_scales(KdTree(cloud.points, -1), cloud.points, places, SIZES)[0]
    errors = [some.error(normals[:, size]) for size in range(len(SIZES))]
    return str(SIZES[int(np.argmin(errors))]), min(errors)


def planes(cloud: Cloud) -> np.ndarray:
    """Return Open3D's normals."""
    import open3d as o3d

    pcd = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(cloud.points))
    pcd.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(30))
    return np.asarray(pcd.normals)


if __name__ == "__main__":
    sys.exit(main())
