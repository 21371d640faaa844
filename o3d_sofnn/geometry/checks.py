"""Checks after each stage: values that are not finite and open meshes become errors."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.geometry import mesh_properties


def check_stage(stage: str, **arrays: NDArray[Any]) -> None:
    """Raise ``ValueError`` if a stage of the pipeline has computed values that are not finite.

    Parameters
    ----------
    stage : str
        Name of the stage, for the message.
    **arrays
        Its results, by name.
    """
    for name, values in arrays.items():
        if not np.isfinite(values).all():
            bad = values.size - int(np.count_nonzero(np.isfinite(values)))
            raise ValueError(
                f"points: no result for these: {bad} {name} are not finite after stage '{stage}'"
            )


def check_mesh(
    vertices: NDArray[np.float64], triangles: NDArray[np.integer[Any]], closed: bool
) -> bool:
    """Raise ``ValueError`` unless a mesh is what the pipeline promises.

    Parameters
    ----------
    vertices, triangles : numpy.ndarray, shapes (m, 3) and (f, 3)
        The mesh.
    closed : bool
        Whether every edge must have two triangles that run through it in opposite directions.

    Returns
    -------
    bool
        Whether it is closed.
    """
    check_stage("surface", vertices=vertices)
    below = int(triangles.min(initial=0)) >= 0
    if not below or int(triangles.max(initial=-1)) >= len(vertices):
        raise ValueError("points: no result for these: stage 'surface' names vertices that are not")
    watertight = mesh_properties.is_watertight(triangles)
    if closed and not watertight:
        raise ValueError("points: no result for these: stage 'surface' has left the mesh open")
    return watertight
