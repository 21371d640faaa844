"""The two operators for Open3D users: oriented normals, and a watertight mesh.

They adapt clouds and options; the stages of the method are in `o3d_sofnn.pipeline`.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from o3d_sofnn import adapters, pipeline, validation
from o3d_sofnn.meshing.attributes import carry
from o3d_sofnn.options import Options
from o3d_sofnn.progress import ProgressBar, ProgressCallback
from o3d_sofnn.results import (
    NormalEstimate,
    SurfaceEstimate,
    left_out,
    scatter_normals,
    scatter_surface,
)

_logger = logging.getLogger(__name__)

NormalDetails = NormalEstimate
SurfaceDetails = SurfaceEstimate


def estimate_normals(
    pcd: Any,
    search_param: Any = None,
    *,
    viewpoint: ArrayLike | None = None,
    towards: ArrayLike | None = None,
    n_threads: int = -1,
    print_progress: bool | ProgressCallback = False,
    return_details: bool = False,
) -> Any:
    """Estimate outward, unit normals for all points of a cloud that has none.

    Parameters
    ----------
    pcd : open3d.geometry.PointCloud or open3d.t.geometry.PointCloud
        The cloud, in any unit. Its normals are written in place; nothing else in it changes.
        Normals that it has are not looked at. A tensor cloud on a GPU is copied to the host, and
        the normals back to its device.
    search_param : open3d.geometry.KDTreeSearchParamKNN, ...Radius, ...Hybrid, optional
        Largest neighbourhood of a local fit, in points, in the cloud's unit, or both. None finds
        it from the data.
    viewpoint : array_like, shape (3,) or (n, 3), optional
        Where the scanner stood, in the cloud's coordinates, for all points or for each of them (one
        row a point, those that are not finite included): every normal faces it, and points that
        hang between things as seen from there (mixed pixels) are outliers.
    towards : array_like, shape (3,), optional
        The same for a scanner that was far away: a direction that every normal faces. At most one
        of ``viewpoint`` and ``towards``. With neither, normals face where the points were seen from
        if the points tell: the camera of a depth image, scanners that explain the density, the sky
        above level ground. Else they face outward; an open sheet then faces the side from which it
        looks convex as a whole; where neither side is (a plane) it faces up (z, else y, else x),
        its confidence is 0, and a warning in the details says so. What has decided, with its
        figures, is in ``details.evidence``.
    n_threads : int, default -1
        -1 uses all cores. The result is the same for any number.
    print_progress : bool or callable, default False
        True draws a bar on the standard error stream; a callable gets (fraction, text).
    return_details : bool, default False
        Return the details too.

    Returns
    -------
    pcd : open3d.geometry.PointCloud or open3d.t.geometry.PointCloud
        The cloud that was given. Rows with NaN or infinity have the normal (0, 0, 0).
    details : NormalDetails
        Only with ``return_details``: one row per point of ``pcd``; None for an empty cloud.

    Raises
    ------
    ValueError
        ``pcd`` has 1 to 3 finite points, or they coincide or lie on a line; an option is out of
        range; ``pcd`` is no point cloud.
    ImportError
        Open3D is missing; the message says what to type.

    Notes
    -----
    An empty cloud is returned unchanged with a warning in the log, as Open3D does.
    """
    cloud = adapters.read_cloud(pcd)
    return_details = validation.check_flag(return_details, "return_details")
    max_nn, radius = adapters.read_search_param(search_param)
    options = Options.checked(
        len(cloud.points),
        max_nn=max_nn,
        radius=radius,
        viewpoint=viewpoint,
        towards=towards,
        n_threads=n_threads,
    )
    if len(cloud.points) == 0:
        _logger.warning("pcd has no points: returned unchanged")
        return (pcd, None) if return_details else pcd
    finite = _finite_points(cloud)
    with _progress(print_progress) as progress:
        estimate = pipeline.estimate_normals(
            _rows(cloud.points, finite), options.of_rows(finite), progress=progress
        )
    _logger.info(estimate.evidence.text)
    for warning in estimate.warnings:
        _logger.warning(warning)
    details = scatter_normals(estimate, finite)
    adapters.write_normals(pcd, details.normals)
    return (pcd, details) if return_details else pcd


def reconstruct_surface(
    pcd: Any,
    *,
    depth: int | None = None,
    voxel_size: float | None = None,
    use_normals: bool = False,
    viewpoint: ArrayLike | None = None,
    towards: ArrayLike | None = None,
    closed: bool | Literal["auto"] = "auto",
    trim: float | Literal["auto"] | None = None,
    target_triangles: int | None = None,
    precision: float | None = None,
    search_param: Any = None,
    n_threads: int = -1,
    print_progress: bool | ProgressCallback = False,
    return_details: bool = False,
) -> Any:
    """Reconstruct a triangle mesh from a cloud without normals: watertight where it is a solid.

    Parameters
    ----------
    pcd : open3d.geometry.PointCloud or open3d.t.geometry.PointCloud
        The cloud, in any unit; not changed. Rows with NaN or infinity are left out.
    depth : int, optional
        Resolution: the largest side of the bounding box has 2**depth cells (1 to 16). None finds
        it from the spacing of the points.
    voxel_size : float, optional
        Resolution: side of a cell, in the cloud's unit. At most one of ``depth``, ``voxel_size``.
    use_normals : bool, default False
        Take the sides of the surface from the cloud's own normals. False ignores them.
    viewpoint, towards : array_like, optional
        As in :func:`estimate_normals`: the surface faces where the scanner stood, or a direction.
        At most one of ``use_normals``, ``viewpoint`` and ``towards``.
    closed : bool or "auto", default "auto"
        "auto" closes the mesh where the points say it is a solid, and leaves it open where nothing
        was measured, with small holes closed; ``details.closing`` says what was decided and why.
        True closes it whatever the points say, False leaves every hole open.
    trim : float or "auto", optional
        Cut away what has a confidence (0 to 1) below this, along a smooth border, in place of what
        ``closed`` says. "auto" is another name for ``closed="auto"``.
    target_triangles : int, optional
        Decimate to so many triangles (at least 4); a closed mesh stays closed. None keeps all.
    precision : float, optional
        Largest distance that the local surfaces shall leave to the points (epsilon of Algorithm 2),
        in the cloud's unit. None takes it from the noise.
    search_param : open3d.geometry.KDTreeSearchParamKNN, ...Radius, ...Hybrid, optional
        Largest neighbourhood of a local fit, in points, in the cloud's unit, or both. None finds
        it from the data.
    n_threads : int, default -1
        -1 uses all cores. The result is the same for any number.
    print_progress : bool or callable, default False
        True draws a bar on the standard error stream; a callable gets (fraction, text).
    return_details : bool, default False
        Return the details too.

    Returns
    -------
    mesh : open3d.geometry.TriangleMesh or open3d.t.geometry.TriangleMesh
        The family of ``pcd``, with vertex normals, and colours when ``pcd`` has them. On a tensor
        mesh the other attributes of the points too: floating-point ones blended, others (labels)
        from the point that counts most.
    details : SurfaceDetails
        Only with ``return_details``; per-point arrays have one row per point of ``pcd``.

    Raises
    ------
    ValueError
        ``pcd`` has less than 4 finite points, or they coincide, or lie on a line or in a plane
        (in a plane: only with ``closed=True``); ``use_normals`` without normals; an option is out
        of range; ``pcd`` is no point cloud.
    ImportError
        Open3D is missing; the message says what to type.
    """
    cloud = adapters.read_cloud(pcd)
    return_details = validation.check_flag(return_details, "return_details")
    max_nn, radius = adapters.read_search_param(search_param)
    options = Options.checked(
        len(cloud.points),
        use_normals=use_normals,
        max_nn=max_nn,
        radius=radius,
        viewpoint=viewpoint,
        towards=towards,
        n_threads=n_threads,
        depth=depth,
        voxel_size=voxel_size,
        closed=closed,
        trim=trim,
        target_triangles=target_triangles,
        precision=precision,
    )
    finite = _finite_points(cloud)
    normals = _own_normals(cloud, finite) if use_normals else None
    with _progress(print_progress) as progress:
        estimate = pipeline.reconstruct_surface(
            _rows(cloud.points, finite),
            options.of_rows(finite),
            normals=None if normals is None else _rows(normals, finite),
            progress=progress,
        )
    for warning in estimate.warnings:
        _logger.warning(warning)
    details = scatter_surface(estimate, finite)
    mesh = adapters.make_mesh(
        pcd,
        details.vertices,
        details.triangles,
        details.vertex_normals,
        carry(details, cloud.attributes),
    )
    return (mesh, details) if return_details else mesh


@contextlib.contextmanager
def _progress(print_progress: bool | ProgressCallback) -> Iterator[ProgressCallback | None]:
    if callable(print_progress):
        yield print_progress
    elif validation.check_flag(print_progress, "print_progress", "True, False or a callable"):
        with contextlib.closing(ProgressBar()) as bar:
            yield bar
    else:
        yield None


def _finite_points(cloud: adapters.CloudArrays) -> NDArray[np.bool_]:
    """Return the mask of finite points; too few of them are an error, some missing a warning."""
    finite = validation.finite_rows(cloud.points)
    count = int(np.count_nonzero(finite))
    validation.check_point_count(count, "pcd")
    validation.check_magnitude(_rows(cloud.points, finite), "pcd")
    if count < len(finite):
        _logger.warning(left_out(finite))
    return finite


def _own_normals(cloud: adapters.CloudArrays, finite: NDArray[np.bool_]) -> NDArray[np.float64]:
    if cloud.normals is None:
        raise ValueError("use_normals: expected a cloud with normals, got one without")
    bad = int(np.count_nonzero(finite & ~validation.finite_rows(cloud.normals)))
    if bad:
        raise ValueError(f"use_normals: expected finite normals, got {bad} rows with NaN or inf")
    if not cloud.normals[finite].any():
        raise ValueError("use_normals: expected normals, got zero vectors only")
    return cloud.normals


def _rows(array: NDArray[np.float64], mask: NDArray[np.bool_]) -> NDArray[np.float64]:
    return array if mask.all() else array[mask]
