"""What a run leaves for the user besides the mesh of all: meshes and normals of the tiles."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.files import point_files
from o3d_sofnn.tiles.work.store import load_arrays
from o3d_sofnn.tiles.work.tasks import finished, name_of

if TYPE_CHECKING:
    from o3d_sofnn.tiles.work.run import Reached

FORMATS = ("ply", "glb")
"""Formats of the meshes of tiles."""


def write_meshes(reached: Reached, folder: Path, ending: str, crs: str | None) -> int:
    """Write the mesh of each tile; neighbours have the same places along their borders.

    Parameters
    ----------
    reached : Reached
        The run.
    folder : Path
        Where to write; created if needed.
    ending : str
        "ply" or "glb".
    crs : str or None
        Coordinate system.

    Returns
    -------
    int
        Number of files.
    """
    folder.mkdir(exist_ok=True)
    job, count = reached.job, 0
    for tile in job.tiles:
        part = finished(job, tile.number)
        own = reached.pieces[tile.number][part.piece] if len(part.piece) else np.zeros(0, bool)
        triangles = part.triangles[own[part.triangles[:, 0]]]
        if not len(triangles):
            continue
        rows, index = np.unique(triangles, return_inverse=True)
        confidence = part.confidence[rows].astype(np.float32)[:, None]
        vertices = CloudArrays(
            reached.outside(part.vertices[rows]),
            part.normals[rows],
            {"confidence": confidence} if ending == "ply" else {},
        )
        path = folder / f"{tile.number:06d}.{ending}"
        point_files.write_triangle_mesh(path, (vertices, index.reshape(-1, 3)), crs=crs)
        count += 1
    return count


def write_normals(reached: Reached, folder: Path, crs: str | None) -> int:
    """Write the points of each tile with their normals as LAZ; return the number of points."""
    folder.mkdir(exist_ok=True)
    job, count = reached.job, 0
    for tile in (tile for tile in job.tiles if tile.count):
        learned = load_arrays(job.folder, name_of("learned", tile.number))
        points = reached.outside(job.points(tile))
        flags: dict[str, NDArray[np.float32] | NDArray[np.uint8]] = {
            "confidence": learned["points.confidence"].astype(np.float32),
            "outlier": learned["points.outliers"].astype(np.uint8),
        }
        path = folder / f"{tile.number:06d}.laz"
        cloud = CloudArrays(points, learned["points.normals"])
        point_files.write_point_cloud(path, cloud, extra=flags, crs=crs)
        count += len(points)
    return count


def check_folder(out: str | os.PathLike[str]) -> Path:
    """Return the folder of the results, created if needed.

    Raises
    ------
    ValueError
        There is something else of that name.
    OSError
        It cannot be created or written.
    """
    path = Path(out)
    if path.exists() and not path.is_dir():
        raise ValueError(f"out: expected a folder, got the file {path}")
    path.mkdir(parents=True, exist_ok=True)
    point_files.check_output(path / "mesh.ply", point_files.MESH_OUTPUTS)
    return path
