"""GLB: glTF 2.0 in one file, in single precision relative to a local origin."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.files.writers.colors import color_levels
from o3d_sofnn.files.writers.origin import local_origin

if TYPE_CHECKING:
    from o3d_sofnn.adapters import CloudArrays


_TYPES = {"|u1": 5121, "<u4": 5125, "<f4": 5126}


_WIDTHS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


_VERTICES, _INDICES = 34962, 34963


_POINTS, _TRIANGLES = 0, 4


def write_mesh_glb(stream: BinaryIO, vertices: CloudArrays, triangles: NDArray[np.int64]) -> None:
    """Write a GLB with normals and colours.

    Coordinates far from zero are stored relative to an origin that the node of the mesh adds again,
    in double precision: programs that apply transformations restore them.

    Raises
    ------
    ValueError
        Vertices are not finite, or there are more than 32 bits can count.
    """
    if not np.isfinite(vertices.points).all():
        raise ValueError("mesh: expected finite vertices for GLB, got NaN or inf")
    parts = _Parts()
    scene: dict[str, Any] = {}
    if len(vertices.points):
        origin = local_origin(vertices.points)
        node: dict[str, Any] = {"mesh": 0}
        if origin.any():
            node["translation"] = origin.tolist()
        attributes = {"POSITION": parts.add(vertices.points - origin, "<f4", bounds=True)}
        if vertices.normals is not None:
            attributes["NORMAL"] = parts.add(vertices.normals, "<f4")
        colors = color_levels(vertices, "u1")
        if colors is not None:
            opaque = np.full((len(colors), 1), 255, dtype=np.uint8)
            attributes["COLOR_0"] = parts.add(np.hstack([colors, opaque]), "|u1")
        primitive: dict[str, Any] = {"attributes": attributes, "mode": _POINTS}
        if len(triangles):
            indices = parts.add(triangles.reshape(-1, 1), "<u4", _INDICES)
            primitive |= {"mode": _TRIANGLES, "indices": indices}
        scene = {
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [node],
            "meshes": [{"primitives": [primitive]}],
            "accessors": parts.accessors,
            "bufferViews": parts.views,
            "buffers": [{"byteLength": parts.size}],
        }
    contents = {"asset": {"version": "2.0", "generator": "o3d_sofnn"}, **scene}
    text = json.dumps(contents, separators=(",", ":"), allow_nan=False).encode()
    chunks = [(b"JSON", [text + b" " * (-len(text) % 4)])]
    if parts.data:
        chunks.append((b"BIN\0", parts.data))
    sizes = [sum(map(len, data)) for _, data in chunks]
    total = 12 + sum(8 + size for size in sizes)
    if total >= 2**32:
        raise ValueError(f"mesh: expected less than 4 GiB for GLB, got {total} bytes")
    stream.write(struct.pack("<4sII", b"glTF", 2, total))
    for (kind, data), size in zip(chunks, sizes, strict=True):
        stream.write(struct.pack("<I4s", size, kind))
        for piece in data:
            stream.write(piece)


class _Parts:
    """Consecutive arrays, and their descriptions in the JSON part."""

    def __init__(self) -> None:
        self.data: list[bytes] = []
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        self.size = 0

    def add(
        self, values: NDArray[Any], kind: str, target: int = _VERTICES, bounds: bool = False
    ) -> int:
        """Add an (n, k) array, whose rows take a multiple of four bytes; return its number."""
        stored = values.astype(kind)
        data = stored.tobytes()
        self.views.append(
            {"buffer": 0, "byteOffset": self.size, "byteLength": len(data), "target": target}
        )
        accessor = {
            "bufferView": len(self.accessors),
            "componentType": _TYPES[kind],
            "count": len(stored),
            "type": _WIDTHS[stored.shape[1]],
        }
        if kind == "|u1":
            accessor["normalized"] = True
        if bounds:
            accessor |= {"min": stored.min(axis=0).tolist(), "max": stored.max(axis=0).tolist()}
        self.accessors.append(accessor)
        self.data.append(data)
        self.size += len(data)
        return len(self.accessors) - 1
