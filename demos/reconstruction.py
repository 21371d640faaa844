"""Reconstruction of one cloud with ``reconstruct_surface``, for quickstart and gallery."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from inputs import Cloud
from numpy.typing import NDArray
from pictures import Panel

from o3d_sofnn.compare.colors import direction_colors

Array = NDArray[Any]


@dataclass(frozen=True)
class Result:
    """A cloud, its normals and its mesh, as arrays.

    Attributes
    ----------
    cloud : Cloud
        The input.
    normals : (n, 3) float64
        Normals of the points.
    vertices : (m, 3) float64
        Vertices of the mesh.
    triangles : (f, 3) int32
        Triangles of the mesh.
    colors : (m, 3) float64, optional
        Colours of the vertices, if the points had colours.
    watertight : bool
        Whether the mesh is closed.
    seconds : float
        Wall time of the reconstruction.
    """

    cloud: Cloud
    normals: Array
    vertices: Array
    triangles: Array
    colors: Array | None
    watertight: bool
    seconds: float

    def points_panel(self) -> Panel:
        """Return the input as a panel."""
        return Panel(
            f"{len(self.cloud.points):,} points", self.cloud.points, None, self.cloud.colors
        )

    def normals_panel(self) -> Panel:
        """Return the points as a panel, coloured by the direction of their normals."""
        return Panel(
            "normals by direction", self.cloud.points, None, direction_colors(self.normals)
        )

    def mesh_panel(self) -> Panel:
        """Return the mesh as a panel."""
        kind = "closed" if self.watertight else "open"
        caption = f"{kind}, {len(self.triangles):,} triangles"
        return Panel(caption, self.vertices, self.triangles, self.colors)


def reconstruct(cloud: Cloud, mesh_file: Path | None, options: dict[str, Any]) -> Result:
    """Reconstruct a cloud and write the mesh.

    Parameters
    ----------
    cloud : Cloud
        The input; its ``trim`` is used.
    mesh_file : Path or None
        Where to write the mesh; None writes nothing.
    options : dict
        Further options of ``o3d_sofnn.reconstruct_surface``.

    Returns
    -------
    Result
    """
    import o3d_sofnn
    from o3d_sofnn.files import point_files

    pcd = cloud.open3d()
    started = time.perf_counter()
    mesh, details = o3d_sofnn.reconstruct_surface(
        pcd, trim=cloud.trim, return_details=True, **options
    )
    seconds = time.perf_counter() - started
    if mesh_file is not None:
        point_files.write_triangle_mesh(mesh_file, mesh)
    return Result(
        cloud,
        details.normals.normals,
        np.asarray(mesh.vertices).copy(),
        np.asarray(mesh.triangles).copy(),
        np.asarray(mesh.vertex_colors).copy() if mesh.has_vertex_colors() else None,
        details.watertight,
        seconds,
    )
