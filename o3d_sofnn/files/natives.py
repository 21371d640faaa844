"""E57 through pye57 and FBX through Open3D, in separate processes: files can crash their C++."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import adapters
from o3d_sofnn.files import child, columns, triangles
from o3d_sofnn.files.columns import Array, PointFile
from o3d_sofnn.files.regular import open_regular
from o3d_sofnn.files.triangles import Triangles

# Fields of E57 that are read, and the numbers they are read into.
_E57_FIELDS = {
    "cartesianX": "f8",
    "cartesianY": "f8",
    "cartesianZ": "f8",
    "sphericalRange": "f8",
    "sphericalAzimuth": "f8",
    "sphericalElevation": "f8",
    "cartesianInvalidState": "i1",
    "sphericalInvalidState": "i1",
    "intensity": "f4",
    "colorRed": "f4",
    "colorGreen": "f4",
    "colorBlue": "f4",
    "nor:normalX": "f4",
    "nor:normalY": "f4",
    "nor:normalZ": "f4",
}


_SPHERICAL = ("sphericalRange", "sphericalAzimuth", "sphericalElevation")


_NORMALS = ("nor:normalX", "nor:normalY", "nor:normalZ")


# Points that libE57 unpacks at a time, whatever number the file claims.
_BLOCK = 2**18


def read_e57(path: Path) -> PointFile:
    """Read the points of all scans in the coordinates of the file, with the scanners' positions.

    Raises
    ------
    OSError
        The file cannot be opened.
    ValueError
        The file is not E57, or damaged.
    ImportError
        pye57 is missing; the message says what to type.
    """
    scans, notes, crs = [], [], None
    places: list[list[float] | None] = []
    for meta, found in _received(path):
        crs = meta["crs"] or None
        points, valid = _e57_points(found)
        named = {name: values for name, values in found.items() if not _is_place(name)}
        rotation, translation = _turn(meta["rotation"]), np.array(meta["translation"])
        scan = dict(zip("xyz", (points @ rotation.T + translation).T, strict=True))
        if set(_NORMALS) <= named.keys():
            turned = np.stack([named.pop(name) for name in _NORMALS], axis=1) @ rotation.T
            scan |= dict(zip(("nx", "ny", "nz"), turned.T, strict=True))
        scans.append({name: values[valid] for name, values in (named | scan).items()})
        places.append(meta["translation"] if meta["has_pose"] else None)
        notes += [f"scan {len(scans)}: {name} left out" for name in meta["others"]]
        if not valid.all():
            lost = len(valid) - int(np.count_nonzero(valid))
            notes.append(f"scan {len(scans)}: {lost} of {len(valid)} places hold no point")
    if not scans:
        raise ValueError(f"{path}: expected scans, got none")
    shared = [name for name in scans[0] if all(name in scan for scan in scans)]
    lost_names = sorted({name for scan in scans for name in scan} - set(shared))
    if lost_names:
        notes.append(f"left out, as not all scans have them: {' '.join(lost_names)}")
    joined = {name: np.concatenate([scan[name] for scan in scans]) for name in shared}
    counts = [len(scan["x"]) for scan in scans]
    return columns.from_columns(path, joined, notes, viewpoint=_seen_from(places, counts), crs=crs)


def _seen_from(places: list[list[float] | None], counts: list[int]) -> Array | None:
    """Return the positions of the scanners; None if one is unknown, or all are the origin.

    Programs that merge scans write the origin for an unknown position.
    """
    known = [place for place in places if place is not None]
    if len(known) < len(places) or not np.any(known) or not np.isfinite(known).all():
        return None
    if len(known) == 1:
        return np.array(known[0])
    return np.repeat(np.array(known), counts, axis=0)


def _e57_points(found: dict[str, NDArray[Any]]) -> tuple[Array, NDArray[np.bool_]]:
    """Return the (n, 3) coordinates of a scan, and which of them are points."""
    if "cartesianX" in found:
        points = np.stack([found[f"cartesian{axis}"] for axis in "XYZ"], axis=1)
        state = found.get("cartesianInvalidState")
    else:
        distance, azimuth, elevation = (found[name] for name in _SPHERICAL)
        level = distance * np.cos(elevation)
        points = np.stack(
            [level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(elevation)], axis=1
        )
        state = found.get("sphericalInvalidState")
    return points, np.ones(len(points), dtype=bool) if state is None else state == 0


def _is_place(name: str) -> bool:
    return name.startswith(("cartesian", "spherical"))


def _turn(quaternion: list[float]) -> Array:
    """Return the rotation matrix of a quaternion w x y z of any length."""
    w, x, y, z = np.array(quaternion) / (np.linalg.norm(quaternion) or 1.0)
    vector = np.array([x, y, z])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn: Array = (
        (w * w - vector @ vector) * np.eye(3) + 2 * np.outer(vector, vector) + 2 * w * cross
    )
    return turn


def read_fbx(path: Path) -> PointFile:
    """Read the vertices, with the attributes that Open3D reads.

    Raises
    ------
    OSError
        The file cannot be opened.
    ValueError
        Open3D cannot read it.
    ImportError
        Open3D is missing; the message says what to type.
    """
    _, found = next(_received(path))
    points, normals = found["points"].reshape(-1, 3), found["normals"].reshape(-1, 3)
    colors = found["colors"].reshape(-1, 3)
    attributes = {"colors": colors} if len(colors) else {}
    return PointFile(points, normals if len(normals) else None, attributes)


def read_fbx_mesh(path: Path) -> tuple[Array, Triangles]:
    """Read the (m, 3) vertices and the (f, 3) triangles."""
    _, found = next(_received(path))
    points = found["points"].reshape(-1, 3)
    return points, triangles.checked(found["triangles"], len(points), path)


def _received(path: Path) -> Iterator[tuple[dict[str, Any], dict[str, NDArray[Any]]]]:
    """Yield what the other process sends: a dictionary, and the arrays named in it."""
    with open_regular(path):
        pass
    incoming = child.run(__name__, path)
    for head in incoming:
        meta = json.loads(head)
        arrays = {name: np.frombuffer(next(incoming), kind) for name, kind in meta["arrays"]}
        yield meta, arrays


def frames(path: str) -> Iterator[bytes]:
    """Yield a dictionary as JSON, and the bytes of its arrays; runs in the other process."""
    parts = _read_fbx(path) if path.lower().endswith(".fbx") else _read_e57(path)
    for meta, arrays in parts:
        meta["arrays"] = [(name, values.dtype.str) for name, values in arrays.items()]
        yield json.dumps(meta).encode()
        for values in arrays.values():
            yield values.tobytes()


def _read_fbx(path: str) -> Iterator[tuple[dict[str, Any], dict[str, NDArray[Any]]]]:
    mesh = adapters.import_open3d().io.read_triangle_mesh(path)
    vertices, faces = adapters.read_mesh(mesh)
    if len(vertices.points) == 0:
        raise ValueError("no vertices")
    nothing = np.zeros((0, 3))
    normals = nothing if vertices.normals is None else vertices.normals
    colors = vertices.attributes.get("colors", nothing)
    yield {}, {"points": vertices.points, "normals": normals, "colors": colors, "triangles": faces}


def _read_e57(path: str) -> Iterator[tuple[dict[str, Any], dict[str, NDArray[Any]]]]:
    try:
        from pye57 import libe57
    except ModuleNotFoundError as error:
        raise ImportError('E57 files need pye57; type: pip install "o3d_sofnn[e57]"') from error
    image = libe57.ImageFile(path, "r")
    root = image.root()
    crs = root["coordinateMetadata"].value() if root.isDefined("coordinateMetadata") else ""
    for scan in root["data3D"]:
        points = scan["points"]
        prototype = libe57.StructureNode(points.prototype())
        names = [prototype.get(i).elementName() for i in range(prototype.childCount())]
        wanted = [name for name in _E57_FIELDS if name in names]
        meta = {
            "crs": crs,
            "has_pose": scan.isDefined("pose"),
            "rotation": _numbers(scan, "rotation", "wxyz", [1.0, 0.0, 0.0, 0.0]),
            "translation": _numbers(scan, "translation", "xyz", [0.0, 0.0, 0.0]),
            "others": [name for name in names if name not in _E57_FIELDS],
        }
        yield meta, _read_e57_points(libe57, image, points, wanted)


def _numbers(scan: Any, part: str, names: str, default: list[float]) -> list[float]:
    path = f"pose/{part}"
    return [scan[path][name].value() for name in names] if scan.isDefined(path) else default


def _read_e57_points(libe57: Any, image: Any, points: Any, wanted: list[str]) -> dict[str, Any]:
    blocks = {name: np.zeros(_BLOCK, _E57_FIELDS[name]) for name in wanted}
    buffers = libe57.VectorSourceDestBuffer()
    for name, block in blocks.items():
        buffers.append(libe57.SourceDestBuffer(image, name, block, _BLOCK, True, True))
    found: dict[str, list[NDArray[Any]]] = {name: [block[:0]] for name, block in blocks.items()}
    reader = points.reader(buffers)
    total = 0
    while count := reader.read():
        total += count
        for name, block in blocks.items():
            found[name].append(block[:count].copy())
    reader.close()
    if total != points.childCount():
        raise ValueError(f"cut short: {total} of {points.childCount()} points")
    return {name: np.concatenate(parts) for name, parts in found.items()}
