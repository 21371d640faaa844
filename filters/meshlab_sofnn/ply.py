"""A surface as a binary PLY file that PyMeshLab reads without a loss."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshlab_sofnn.engine import Surface

_TYPES = {"<f8": "double", "u1": "uchar"}


def write_ply(path: Path, surface: Surface) -> None:
    """Write a surface with normals, confidence ("quality") and colours, if it has any.

    Parameters
    ----------
    path : Path
        Overwritten.
    surface : Surface

    Raises
    ------
    OSError
        The file cannot be written.
    """
    columns: list[tuple[str, str, NDArray[Any]]]
    columns = [(name, "<f8", surface.vertices[:, k]) for k, name in enumerate(("x", "y", "z"))]
    columns += [(name, "<f8", surface.normals[:, k]) for k, name in enumerate(("nx", "ny", "nz"))]
    columns.append(("quality", "<f8", surface.confidence))
    if surface.colors is not None:
        channels = ("red", "green", "blue", "alpha")
        columns += [(name, "u1", surface.colors[:, k]) for k, name in enumerate(channels)]
    vertices = np.empty(len(surface.vertices), [(name, kind) for name, kind, _ in columns])
    for name, _, values in columns:
        vertices[name] = values
    faces = np.empty(len(surface.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    faces["corners"] = surface.triangles
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"element vertex {len(vertices)}",
        *(f"property {_TYPES[kind]} {name}" for name, kind, _ in columns),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    with path.open("wb") as file:
        file.write("\n".join(header).encode("ascii"))
        file.write(vertices.tobytes())
        file.write(faces.tobytes())
