"""The first operator: oriented normals, in the kind of object that the points came in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, overload

from numpy.typing import ArrayLike

from o3d_sofnn import pipeline, validation
from o3d_sofnn.operators.common import (
    finite_points,
    inform,
    neighborhood,
    progress_of,
    rows_of,
    warn,
)
from o3d_sofnn.operators.families import family_of
from o3d_sofnn.options import Options
from o3d_sofnn.progress import ProgressCallback
from o3d_sofnn.results import NormalEstimate, scatter_normals

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from o3d_sofnn.operators.signatures import Array, Cloud, NormalOptions, Points

NormalDetails = NormalEstimate


@overload
def estimate_normals(
    pcd: Points, search_param: Any = ..., **options: Unpack[NormalOptions]
) -> Array: ...
@overload
def estimate_normals(
    pcd: Points,
    search_param: Any = ...,
    *,
    return_details: Literal[True],
    **options: Unpack[NormalOptions],
) -> tuple[Array, NormalDetails]: ...
@overload
def estimate_normals(
    pcd: Cloud, search_param: Any = ..., **options: Unpack[NormalOptions]
) -> Cloud: ...
@overload
def estimate_normals(
    pcd: Cloud,
    search_param: Any = ...,
    *,
    return_details: Literal[True],
    **options: Unpack[NormalOptions],
) -> tuple[Cloud, NormalDetails | None]: ...


def estimate_normals(
    pcd: Any,
    search_param: Any = None,
    *,
    fast_normal_computation: bool = True,
    max_nn: int | None = None,
    radius: float | None = None,
    viewpoint: ArrayLike | None = None,
    towards: ArrayLike | None = None,
    n_threads: int = -1,
    print_progress: bool | ProgressCallback = False,
    return_details: bool = False,
) -> Any:
    """Estimate outward, unit normals for all points of a cloud that has none.

    Parameters
    ----------
    pcd : array_like, shape (n, 3), or cloud
        The points, in any unit. A cloud is a PointCloud of Open3D (legacy or tensor) or trimesh,
        or a PolyData of PyVista: its normals are written in place, nothing else in it changes, and
        normals that it already has are ignored. A tensor cloud on a GPU is copied to the host, and
        the normals back to its device; trimesh keeps them in ``pcd.metadata["normals"]``.
    search_param : open3d.geometry.KDTreeSearchParamKNN, ...Radius, ...Hybrid, optional
        Largest neighbourhood of a local fit: a number of points, a radius in the cloud's unit, or
        both. None finds it from the data.
    fast_normal_computation : bool, default True
        Accepted because Open3D's function has it; it has no effect.
    max_nn, radius : int and float, optional
        The same as ``search_param``, as for tensor clouds of Open3D; not together with it.
    viewpoint : array_like, shape (3,) or (n, 3), optional
        Where the scanner stood, in the cloud's coordinates, for all points or for each of them (one
        row per point, including those that are not finite): every normal faces it, and points that
        hang between objects as seen from there (mixed pixels) are outliers.
    towards : array_like, shape (3,), optional
        The same for a scanner that was far away: a direction that every normal faces. At most one
        of ``viewpoint`` and ``towards``. With neither, normals face the place the points were seen
        from, if the points reveal it: the camera of a depth image, scanners that explain the
        density, the sky above level ground. Otherwise they face outward. An open sheet then faces
        the side from which it looks convex as a whole; if there is none (a plane), it faces up (z,
        else y, else x), its confidence is 0, and a warning in the details says so. What decided,
        with its figures, is in ``details.evidence``.
    n_threads : int, default -1
        -1 uses all cores. The result is the same for any number.
    print_progress : bool or callable, default False
        True draws a bar on the standard error stream, with the time left (and as a widget in
        notebooks) where tqdm is installed; a callable gets (fraction, text).
    return_details : bool, default False
        Return the details too.

    Returns
    -------
    normals : numpy.ndarray, shape (n, 3), or cloud
        For an array, its normals; for a cloud, the same object, with normals. Rows with NaN or
        infinity have the normal (0, 0, 0).
    details : NormalDetails
        Only with ``return_details``: one row per point of ``pcd``; None for an empty cloud.

    Raises
    ------
    ValueError
        ``pcd`` has 1 to 3 finite points, or they coincide or lie on a line; an option is out of
        range; ``pcd`` is neither an array nor a cloud.

    Notes
    -----
    An empty cloud is returned unchanged with a warning, as Open3D does. Doubtful results lead to a
    :class:`ReconstructionWarning` and a line in the log.
    """
    family = family_of(pcd)
    cloud = family.read(pcd)
    return_details = validation.check_flag(return_details, "return_details")
    validation.check_flag(fast_normal_computation, "fast_normal_computation")
    max_nn, radius = neighborhood(search_param, max_nn, radius)
    options = Options.checked(
        len(cloud.points),
        max_nn=max_nn,
        radius=radius,
        viewpoint=viewpoint,
        towards=towards,
        n_threads=n_threads,
    )
    if len(cloud.points) == 0:
        warn("pcd has no points: returned unchanged")
        unchanged = family.with_normals(pcd, cloud.points)
        return (unchanged, None) if return_details else unchanged
    finite = finite_points(cloud)
    with progress_of(print_progress) as progress:
        estimate = pipeline.estimate_normals(
            rows_of(cloud.points, finite), options.of_rows(finite), progress=progress
        )
    inform(estimate.evidence.text)
    warn(*estimate.warnings)
    details = scatter_normals(estimate, finite)
    found = family.with_normals(pcd, details.normals)
    return (found, details) if return_details else found
