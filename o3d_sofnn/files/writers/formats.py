"""Writers of point and mesh files: arrays to a binary stream, every digit kept.

Open3D's own writers report success on a full disk, and keep six digits in OBJ and OFF, which
destroys georeferenced coordinates. These write through Python's file objects, which raise.
"""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.files.writers.colors import color_levels
from o3d_sofnn.files.writers.glb import write_mesh_glb

if TYPE_CHECKING:
    from o3d_sofnn.adapters import CloudArrays


_PLY_TYPES = {
    "i1": "char",
    "u1": "uchar",
    "i2": "short",
    "u2": "ushort",
    "i4": "int",
    "u4": "uint",
    "f4": "float",
    "f8": "double",
}


# Rows formatted at a time by the text writers: bounds their memory.
_TEXT_ROWS = 65536


def write_cloud_ply(stream: BinaryIO, cloud: CloudArrays) -> None:
    """Write a binary PLY with coordinates in double and every attribute of the points."""
    _write_ply(stream, cloud, None)


def write_mesh_ply(stream: BinaryIO, vertices: CloudArrays, triangles: NDArray[np.int64]) -> None:
    """Write a binary PLY with coordinates in double and every attribute of the vertices."""
    _write_ply(stream, vertices, triangles)


def write_cloud_text(stream: BinaryIO, cloud: CloudArrays) -> None:
    """Write lines ``x y z nx ny nz``."""
    rows = np.hstack([cloud.points, _normals(cloud)])
    _write_lines(stream, rows, lambda row: " ".join(map(repr, row)))


def write_cloud_pcd(stream: BinaryIO, cloud: CloudArrays) -> None:
    """Write a binary PCD 0.7 with x y z normals (single precision, as PCL's points) and rgb."""
    columns = [(name, cloud.points[:, i].astype("<f4")) for i, name in enumerate("xyz")]
    normals = _normals(cloud)
    columns += [(f"normal_{name}", normals[:, i].astype("<f4")) for i, name in enumerate("xyz")]
    colors = color_levels(cloud, "u1")
    if colors is not None:
        red, green, blue = colors.astype("<u4").T
        columns.append(("rgb", ((red << 16) | (green << 8) | blue).astype("<u4").view("<f4")))
    names = " ".join(name for name, _ in columns)
    fours, letters, ones = (" ".join(sign * len(columns)) for sign in "4F1")
    count = len(cloud.points)
    stream.write(
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS {names}\nSIZE {fours}\nTYPE {letters}\nCOUNT {ones}\n"
        f"WIDTH {count}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA binary\n".encode()
    )
    stream.write(_records(columns).tobytes())


def write_cloud_npz(stream: BinaryIO, cloud: CloudArrays) -> None:
    """Write a NumPy archive with one array per attribute, as Open3D's tensor reader takes it."""
    arrays = {"positions": cloud.points, "normals": _normals(cloud), **cloud.attributes}
    # Not by np.savez: there, attributes named "file" or "allow_pickle" are arguments.
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, np.asarray(values), allow_pickle=False)


def write_mesh_obj(stream: BinaryIO, vertices: CloudArrays, triangles: NDArray[np.int64]) -> None:
    """Write a Wavefront OBJ: vertices (with colours behind them), normals, faces."""
    rows = vertices.points
    colors = color_levels(vertices, "u1")
    if colors is not None:
        rows = np.hstack([rows, colors / 255.0])
    _write_lines(stream, rows, lambda row: "v " + " ".join(map(repr, row)))
    if vertices.normals is None:
        _write_lines(stream, triangles + 1, lambda row: "f " + " ".join(map(str, row)))
        return
    _write_lines(stream, vertices.normals, lambda row: "vn " + " ".join(map(repr, row)))
    _write_lines(stream, triangles + 1, lambda row: "f " + " ".join(f"{i}//{i}" for i in row))


def write_mesh_off(stream: BinaryIO, vertices: CloudArrays, triangles: NDArray[np.int64]) -> None:
    """Write an OFF, or a COFF when the vertices have colours."""
    colors = color_levels(vertices, "u1")
    kind = "OFF" if colors is None else "COFF"
    stream.write(f"{kind}\n{len(vertices.points)} {len(triangles)} 0\n".encode())
    if colors is None:
        _write_lines(stream, vertices.points, lambda row: " ".join(map(repr, row)))
    else:
        rows = np.hstack([vertices.points, colors])
        _write_lines(
            stream,
            rows,
            lambda row: " ".join([*map(repr, row[:3]), *(str(int(c)) for c in row[3:]), "255"]),
        )
    _write_lines(stream, triangles, lambda row: "3 " + " ".join(map(str, row)))


def write_mesh_stl(stream: BinaryIO, vertices: CloudArrays, triangles: NDArray[np.int64]) -> None:
    """Write a binary STL: facets in single precision, no colours, no shared vertices."""
    corners = vertices.points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    facets = np.zeros(
        len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("zero", "<u2")]
    )
    facets["normal"] = normals
    facets["corners"] = corners
    stream.write(b"o3d_sofnn".ljust(80) + len(triangles).to_bytes(4, "little"))
    stream.write(facets.tobytes())


CLOUD_WRITERS: dict[str, Callable[[BinaryIO, CloudArrays], None]] = {
    ".ply": write_cloud_ply,
    ".pcd": write_cloud_pcd,
    ".xyz": write_cloud_text,
    ".xyzn": write_cloud_text,
    ".npz": write_cloud_npz,
}


MESH_WRITERS: dict[str, Callable[[BinaryIO, CloudArrays, NDArray[np.int64]], None]] = {
    ".ply": write_mesh_ply,
    ".obj": write_mesh_obj,
    ".off": write_mesh_off,
    ".stl": write_mesh_stl,
    ".glb": write_mesh_glb,
}


# What a format keeps beside coordinates; None is everything.
CLOUD_KEEPS: dict[str, frozenset[str] | None] = {
    ".ply": None,
    ".npz": None,
    ".pcd": frozenset({"normals", "colors"}),
    ".las": frozenset({"normals", "colors"}),
    ".laz": frozenset({"normals", "colors"}),
    ".xyz": frozenset({"normals"}),
    ".xyzn": frozenset({"normals"}),
}


MESH_KEEPS: dict[str, frozenset[str] | None] = {
    ".ply": None,
    ".obj": frozenset({"normals", "colors"}),
    # Normals of a mesh follow from its faces.
    ".off": frozenset({"normals", "colors"}),
    ".stl": frozenset({"normals"}),
    ".glb": frozenset({"normals", "colors"}),
}


SINGLE_PRECISION = frozenset({".pcd", ".stl", ".glb"})


# What stores coordinates about a local origin.
WITH_ORIGIN = frozenset({".glb"})


def _normals(cloud: CloudArrays) -> NDArray[np.float64]:
    return np.zeros_like(cloud.points) if cloud.normals is None else cloud.normals


def _write_ply(
    stream: BinaryIO, vertices: CloudArrays, triangles: NDArray[np.int64] | None
) -> None:
    columns = [(name, vertices.points[:, i]) for i, name in enumerate("xyz")]
    if vertices.normals is not None:
        columns += [(f"n{name}", vertices.normals[:, i]) for i, name in enumerate("xyz")]
    colors = color_levels(vertices, "u1")
    if colors is not None:
        columns += [(name, colors[:, i]) for i, name in enumerate(("red", "green", "blue"))]
    for name, values in vertices.attributes.items():
        if name != "colors":
            columns += _ply_columns(name, values)
    records = _records([(name, _ply_number(values)) for name, values in columns])
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(records)}"]
    header += [f"property {_PLY_TYPES[records.dtype[name].str[1:]]} {name}" for name, _ in columns]
    if triangles is not None:
        header += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    stream.write("\n".join([*header, "end_header\n"]).encode())
    stream.write(records.tobytes())
    if triangles is not None:
        faces = np.zeros(len(triangles), dtype=[("count", "u1"), ("indices", "<i4", 3)])
        faces["count"] = 3
        faces["indices"] = triangles
        stream.write(faces.tobytes())


def _ply_columns(name: str, values: NDArray[Any]) -> list[tuple[str, NDArray[Any]]]:
    """Return one named column per component; PLY names hold no white space."""
    name = "_".join(name.split())
    flat = values.reshape(len(values), -1)
    if flat.shape[1] == 1:
        return [(name, flat[:, 0])]
    return [(f"{name}_{i}", flat[:, i]) for i in range(flat.shape[1])]


def _ply_number(values: NDArray[Any]) -> NDArray[Any]:
    """Return ``values`` in a number type that PLY has; 64-bit integers become double."""
    if values.dtype.kind == "b":
        return values.astype("<u1")
    kind = values.dtype.str[1:]
    return values.astype("<" + kind if kind in _PLY_TYPES else "<f8")


def _records(columns: list[tuple[str, NDArray[Any]]]) -> NDArray[Any]:
    """Interleave equally long columns."""
    records = np.zeros(
        len(columns[0][1]), dtype=[(name, values.dtype.str) for name, values in columns]
    )
    for name, values in columns:
        records[name] = values
    return records


def _write_lines(stream: BinaryIO, rows: NDArray[Any], line: Callable[[list[Any]], str]) -> None:
    """Write ``line(row)`` for every row; Python's repr is the shortest text with all digits."""
    for start in range(0, len(rows), _TEXT_ROWS):
        block = rows[start : start + _TEXT_ROWS].tolist()
        stream.write("".join(f"{line(row)}\n" for row in block).encode())
