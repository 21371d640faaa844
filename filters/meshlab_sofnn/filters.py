"""The two filters as plain functions on a ``pymeshlab.MeshSet``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pymeshlab

from meshlab_sofnn.engine import Progress, normals_of_cloud, surface_of_cloud
from meshlab_sofnn.layers import add_surface, box_diagonal, point_layer, read_cloud, write_normals
from meshlab_sofnn.parameters import NORMALS, RECONSTRUCT, parameter_values, pipeline_options


def reconstruct(
    ms: pymeshlab.MeshSet, *, progress: Progress | None = None, **params: Any
) -> dict[str, Any]:
    """Reconstruct the surface of the current layer, a point cloud, as a new layer.

    The new layer "SOFNN mesh" becomes the current one. Its matrix is the identity, its vertex
    scalar the confidence in [0, 1], its colours those of the cloud. The input layer stays
    as it is; its matrix is applied to what is reconstructed.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        The current layer must be a point cloud; vertices that are not finite are ignored.
    progress : callable, optional
        Called with the fraction done (0 to 1) and the stage.
    depth : int, default 0
        Finest level of the extraction grid in the cloud's bounding cube; 0 is automatic. It
        cannot be combined with ``voxel_size``.
    voxel_size : PercentageValue or PureValue, default 0
        Edge of the extraction grid's cells; 0 is automatic.
    use_normals : bool, default False
        Use the vertex normals of the layer instead of estimating them.
    closed : {"auto", "yes", "no"} or int, default "auto"
        Whether holes are closed; "auto" closes solids and small holes.
    trim : float or "auto", default 0
        Remove triangles with a confidence below this (0 to 1); with 0, ``closed`` decides.
        "auto" is another name for ``closed="auto"``.
    target_triangles : int, default 0
        Decimate to so many triangles; 0 keeps all.
    precision : PercentageValue or PureValue, default 0
        Largest distance that the local surfaces leave to the points; 0 is automatic.
    orientation : {"automatic", "viewpoint", "direction"} or int, default "automatic"
        Out of the closed surface, towards ``viewpos``, or along ``direction``.
    viewpos : three floats, default (0, 0, 0)
        Where the cloud was seen from, in world coordinates.
    direction : three floats, default (0, 0, 1)
        Which way the surface should face, in world coordinates.
    max_nn : int, default 0
        Largest number of neighbours in a local fit; 0 is automatic.
    radius : PercentageValue or PureValue, default 0
        Largest radius of a local fit; 0 is automatic.
    n_threads : int, default -1
        Threads; -1 is one per core. The result does not depend on it.

    Returns
    -------
    dict
        ``noise_level``, ``spacing``, ``voxel_size`` (in the cloud's unit), ``outliers``,
        ``offset_points``, ``ignored_points`` (counts), ``watertight`` and ``seconds``.

    Raises
    ------
    pymeshlab.PyMeshLabException
        No layer, a layer that is not a point cloud, unknown or bad parameters, or points that
        have no surface. The MeshSet is then unchanged.
    """
    return run(ms, RECONSTRUCT, params, progress)


def estimate_normals(
    ms: pymeshlab.MeshSet, *, progress: Progress | None = None, **params: Any
) -> dict[str, Any]:
    """Give every vertex of the current layer, a point cloud, an oriented unit normal.

    Parameters
    ----------
    ms : pymeshlab.MeshSet
        The current layer must be a point cloud; vertices that are not finite get the normal 0.
    progress : callable, optional
        Called with the fraction done (0 to 1) and the stage.
    orientation : {"automatic", "viewpoint", "direction"} or int, default "automatic"
        Out of the closed surface, towards ``viewpos``, or along ``direction``.
    viewpos : three floats, default (0, 0, 0)
        Where the cloud was seen from, in world coordinates.
    direction : three floats, default (0, 0, 1)
        Which way the normals should point, in world coordinates.
    max_nn : int, default 0
        Largest number of neighbours in a local fit; 0 is automatic.
    radius : PercentageValue or PureValue, default 0
        Largest radius of a local fit; 0 is automatic.
    n_threads : int, default -1
        Threads; -1 is one per core. The result does not depend on it.

    Returns
    -------
    dict
        ``noise_level``, ``spacing`` (in the cloud's unit), ``outliers``,
        ``ignored_points`` (counts) and ``seconds``.

    Raises
    ------
    pymeshlab.PyMeshLabException
        No layer, a layer that is not a point cloud, unknown or bad parameters, or points that
        have no surface. The MeshSet is then unchanged.
    """
    return run(ms, NORMALS, params, progress)


def run(
    ms: pymeshlab.MeshSet,
    filter_name: str,
    params: Mapping[str, Any],
    progress: Progress | None = None,
) -> dict[str, Any]:
    """Run the filter `RECONSTRUCT` or `NORMALS`, as `reconstruct` and `estimate_normals` do."""
    mesh = point_layer(ms, filter_name)
    values = parameter_values(filter_name, box_diagonal(mesh), params)
    options = pipeline_options(filter_name, values)
    called = None if progress is None else _Called(progress)
    try:
        cloud = read_cloud(mesh, with_normals=values.get("use_normals", False))
        # Only at the end does the MeshSet change.
        if filter_name == RECONSTRUCT:
            surface = surface_of_cloud(cloud, options, called)
            add_surface(ms, surface)
            return surface.summary
        normals, summary = normals_of_cloud(cloud, options, called)
        write_normals(ms, normals)
        return summary
    except pymeshlab.PyMeshLabException:
        raise
    except Exception as error:
        if called is not None and error is called.raised:
            raise
        details = "not enough memory" if isinstance(error, MemoryError) else error
        raise pymeshlab.PyMeshLabException(
            f"Failed to apply filter: {filter_name}\nDetails: {details}"
        ) from error


class _Called:
    """The caller's progress callback; what it raises is the caller's own, not an error of ours."""

    def __init__(self, progress: Progress) -> None:
        self.progress = progress
        self.raised: Exception | None = None

    def __call__(self, fraction: float, text: str) -> None:
        try:
            self.progress(fraction, text)
        except Exception as error:
            self.raised = error
            raise
