"""A replacement for Open3D's Poisson reconstruction function."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import adapters, validation
from o3d_sofnn._kernels import KdTree
from o3d_sofnn.operators.surfaces import reconstruct_surface
from o3d_sofnn.results import SurfaceEstimate
from o3d_sofnn.threads import thread_count, using_threads

SCALE = 1.1
"""Open3D's default for ``scale``."""


def create_from_point_cloud_sofnn(
    pcd: Any,
    depth: int | None = None,
    width: float = 0,
    scale: float = SCALE,
    linear_fit: bool = False,
    n_threads: int = -1,
    **options: Any,
) -> tuple[Any, Any]:
    """Reconstruct a closed mesh as ``TriangleMesh.create_from_point_cloud_poisson`` does.

    In scripts that call Open3D's function and cut away vertices of low density, only the name of
    the function changes; normals are no longer needed.

    Parameters
    ----------
    pcd : open3d.geometry.PointCloud
        The cloud; normals in it are ignored, unless ``use_normals=True``.
    depth : int, optional
        The largest side of the bounding box has 2**depth cells, 1 to 16. None, the default, finds
        the resolution from the points, unlike Poisson's default of 8.
    width : float, default 0
        Edge of a cell, in the cloud's unit; 0 means not given. It is ignored if ``depth`` is given,
        as in Open3D.
    scale, linear_fit : optional
        Parameters of Poisson's own grid, which does not exist here: values other than Open3D's
        defaults, 1.1 and False, raise ValueError.
    n_threads : int, default -1
        -1 uses all cores. The result is the same for any number.
    **options
        Options of :func:`o3d_sofnn.reconstruct_surface` by name. ``closed`` defaults to True.

    Returns
    -------
    mesh : open3d.geometry.TriangleMesh
    densities : open3d.utility.DoubleVector
        One value per vertex, larger where more points support it. Where points support the surface,
        it is the confidence times the depth (found or given), from 0 to `depth`; elsewhere it is
        minus the distance to the nearest point, in cells. So quantiles first cut away what is
        farthest from the points.

    Raises
    ------
    ValueError
        As in :func:`o3d_sofnn.reconstruct_surface`, or `scale` or `linear_fit` is not the default.
    """
    if scale != SCALE:
        raise ValueError(f"scale: expected {SCALE}, there is no other grid here, got {scale}")
    if validation.check_flag(linear_fit, "linear_fit"):
        raise ValueError("linear_fit: expected False, there is no other interpolation here")
    o3d = adapters.import_open3d()
    if not isinstance(pcd, o3d.geometry.PointCloud):
        raise ValueError(f"pcd: expected an open3d.geometry.PointCloud, got {type(pcd).__name__}")
    options = {"closed": True, **options} if options.get("trim") is None else options
    if options.pop("return_details", False):
        raise ValueError("return_details: expected reconstruct_surface for the details")
    mesh, details = reconstruct_surface(
        pcd,
        depth=depth,
        voxel_size=width if width and depth is None else None,
        n_threads=n_threads,
        return_details=True,
        **options,
    )
    with using_threads(n_threads):
        return mesh, o3d.utility.DoubleVector(densities(np.asarray(pcd.points), details))


def densities(points: NDArray[np.float64], details: SurfaceEstimate) -> NDArray[np.float64]:
    """Return what stands for Poisson's densities at the vertices of a mesh, (m,).

    Parameters
    ----------
    points : (n, 3) float64
        That it was made from.
    details : SurfaceEstimate
        The mesh.
    """
    inliers = np.ascontiguousarray(points[~details.normals.outliers])
    middle = inliers.mean(axis=0)
    side = float(np.ptp(inliers, axis=0).max())
    depth = max(np.log2(max(side / details.voxel_size, 1.0)), 1.0)
    found = depth * details.confidence
    far = np.flatnonzero(details.confidence <= 0.0)
    tree = KdTree((inliers - middle) / side, thread_count())
    x = np.ascontiguousarray((details.vertices[far] - middle) / side)
    distance = tree.query(x, 1, np.inf)[0][:, 0]
    found[far] = -distance * side / details.voxel_size
    return np.asarray(found)
