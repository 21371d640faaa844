"""The second operator: a triangle mesh, in the kind of object that the points came in."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from o3d_sofnn import pipeline, validation
from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.meshing.attributes import carry
from o3d_sofnn.operators.common import (
    finite_points,
    neighborhood,
    own_normals,
    progress_of,
    rows_of,
    warn,
)
from o3d_sofnn.operators.families import family_of
from o3d_sofnn.options import Options
from o3d_sofnn.progress import ProgressCallback
from o3d_sofnn.results import SurfaceEstimate, scatter_surface

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from o3d_sofnn.operators.signatures import Array, Cloud, Points, SurfaceOptions

SurfaceDetails = SurfaceEstimate


@overload
def reconstruct_surface(
    pcd: Points, **options: Unpack[SurfaceOptions]
) -> tuple[Array, NDArray[np.int32]]: ...
@overload
def reconstruct_surface(
    pcd: Points, *, return_details: Literal[True], **options: Unpack[SurfaceOptions]
) -> tuple[Array, NDArray[np.int32], SurfaceDetails]: ...
@overload
def reconstruct_surface(pcd: Cloud, **options: Unpack[SurfaceOptions]) -> Any: ...
@overload
def reconstruct_surface(
    pcd: Cloud, *, return_details: Literal[True], **options: Unpack[SurfaceOptions]
) -> tuple[Any, SurfaceDetails]: ...


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
    max_nn: int | None = None,
    radius: float | None = None,
    n_threads: int = -1,
    print_progress: bool | ProgressCallback = False,
    return_details: bool = False,
) -> Any:
    """Reconstruct a triangle mesh from a cloud without normals, watertight if it is a solid.

    Parameters
    ----------
    pcd : array_like, shape (n, 3), or cloud
        The points, in any unit; not changed. A cloud is a PointCloud of Open3D (legacy or tensor)
        or trimesh, or a PolyData of PyVista. Rows with NaN or infinity are left out.
    depth : int, optional
        Resolution: the largest side of the bounding box has 2**depth cells (1 to 16). None finds
        it from the spacing of the points.
    voxel_size : float, optional
        Resolution: edge of a cell, in the cloud's unit. At most one of ``depth``, ``voxel_size``.
    use_normals : bool, default False
        Take the sides of the surface from the cloud's own normals. False ignores them.
    viewpoint, towards : array_like, optional
        As in :func:`estimate_normals`: the surface faces the scanner's place, or a direction.
        At most one of ``use_normals``, ``viewpoint`` and ``towards``.
    closed : bool or "auto", default "auto"
        "auto" closes the mesh where the points enclose a solid, and leaves it open where nothing
        was measured, with small holes closed; ``details.closing`` says what was decided and why.
        True closes it whatever the points show, False leaves every hole open.
    trim : float or "auto", optional
        Cut away everything with a confidence (0 to 1) below this, along a smooth border, instead of
        what ``closed`` says. "auto" is another name for ``closed="auto"``.
    target_triangles : int, optional
        Decimate to this many triangles (at least 4); a closed mesh stays closed. None keeps all.
    precision : float, optional
        Largest allowed distance of the points from the local surfaces (epsilon of Algorithm 2), in
        the cloud's unit. None derives it from the noise.
    search_param : open3d.geometry.KDTreeSearchParamKNN, ...Radius, ...Hybrid, optional
        Largest neighbourhood of a local fit: a number of points, a radius in the cloud's unit, or
        both. None finds it from the data.
    max_nn, radius : int and float, optional
        The same as ``search_param``, without a class of Open3D; not together with it.
    n_threads : int, default -1
        -1 uses all cores. The result is the same for any number.
    print_progress : bool or callable, default False
        True draws a bar on the standard error stream, with the time left (and as a widget in
        notebooks) where tqdm is installed; a callable gets (fraction, text).
    return_details : bool, default False
        Return the details too.

    Returns
    -------
    vertices, triangles : numpy.ndarray, shape (m, 3) and (f, 3)
        Returned for an array; triangles run counter-clockwise as seen from outside.
    mesh : open3d TriangleMesh, trimesh.Trimesh or pyvista.PolyData
        Returned for a cloud: of the same family, with vertex normals, and colours if ``pcd`` has
        them. Tensor meshes and PolyData also have the other attributes of the points:
        floats are blended, others (labels) come from the point with the largest weight.
    details : SurfaceDetails
        Only with ``return_details``; per-point arrays have one row per point of ``pcd``.

    Raises
    ------
    ValueError
        ``pcd`` has fewer than 4 finite points, or they coincide, or lie on a line or (with
        ``closed=True``) in a plane; ``use_normals`` is given without normals; an option is out of
        range; ``pcd`` is neither an array nor a cloud.
    """
    family = family_of(pcd)
    cloud = family.read(pcd)
    return_details = validation.check_flag(return_details, "return_details")
    max_nn, radius = neighborhood(search_param, max_nn, radius)
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
    finite = finite_points(cloud)
    normals = own_normals(cloud, finite) if use_normals else None
    with progress_of(print_progress) as progress:
        estimate = pipeline.reconstruct_surface(
            rows_of(cloud.points, finite),
            options.of_rows(finite),
            normals=None if normals is None else rows_of(normals, finite),
            progress=progress,
        )
    warn(*estimate.warnings)
    details = scatter_surface(estimate, finite)
    attributes = carry(details, cloud.attributes)
    vertices = CloudArrays(details.vertices, details.vertex_normals, attributes)
    mesh = family.mesh(pcd, vertices, details.triangles)
    if not return_details:
        return mesh
    return (*mesh, details) if isinstance(mesh, tuple) else (mesh, details)
