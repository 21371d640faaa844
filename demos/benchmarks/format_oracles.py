"""Points of files as other libraries read them, or a few lines of the plainest code."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NAMES = (
    {"x", "points:0", "easting"},
    {"y", "points:1", "northing"},
    {"z", "points:2", "elevation"},
)


def points_of(path: Path) -> Array | None:
    """Return the (n, 3) coordinates; None where there is no other reader, or it reads nothing."""
    reader = _READERS.get(path.suffix.lower(), _text)
    try:
        found = np.asarray(reader(path), dtype=np.float64).reshape(-1, 3)
    except Exception:  # what other readers raise is theirs
        return None
    return found if len(found) else None


def _text(path: Path) -> list[list[float]]:
    data = path.read_bytes()
    is_wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    return _lines(data.decode("utf-16" if is_wide else "utf-8-sig", "replace"))


def _lines(text: str) -> list[list[float]]:
    found, places = [], [0, 1, 2]
    for line in text.splitlines():
        if "." not in line:
            line = re.sub(r"(?<=\d),(?=\d)", ".", line)
        words = re.split(r"[\s,;|]+", line.strip(" \t\r/").replace('"', ""))
        named = [[i for i, w in enumerate(words) if w.lower() in names] for names in _NAMES]
        if all(named):
            places = [each[0] for each in named]
        try:
            found.append([float(words[place]) for place in places])
        except (ValueError, IndexError):
            continue
    return found


def _ply(path: Path) -> Array:
    import plyfile

    file = plyfile.PlyData.read(path)
    vertices = file["vertex"]
    if file.text:  # whose digits may be more than its types hold
        return np.array(_lines(path.read_text().partition("end_header\n")[2])[: len(vertices)])
    return np.stack([np.asarray(vertices[axis], dtype=np.float64) for axis in "xyz"], axis=1)


def _pcd(path: Path) -> Array:
    _, is_text, body = path.read_bytes().partition(b"DATA ascii\n")
    if is_text:
        return np.array(_lines(body.decode()))
    import open3d

    cloud = open3d.t.io.read_point_cloud(str(path))
    found: Array = cloud.point.positions.numpy().astype(np.float64)
    return found


def _las(path: Path) -> Array:
    import laspy

    found: Array = np.asarray(laspy.read(path).xyz)
    return found


def _e57(path: Path) -> Array:
    import pye57

    file = pye57.E57(str(path))
    scans = [file.read_scan(i, ignore_missing_fields=True) for i in range(file.scan_count)]
    return np.concatenate(
        [np.stack([scan[f"cartesian{axis}"] for axis in "XYZ"], axis=1) for scan in scans]
    )


def _ptx(path: Path) -> Array:
    lines, found = path.read_text().splitlines(), []
    while lines:
        count = int(lines[0]) * int(lines[1])
        pose = np.array([line.split() for line in lines[6:10]], dtype=np.float64)
        local = np.array([line.split()[:3] for line in lines[10 : 10 + count]], dtype=np.float64)
        found.append(local @ pose[:3, :3] + pose[3, :3])
        lines = lines[10 + count :]
    return np.concatenate(found)


def _array(path: Path) -> Any:
    stored = np.load(path)
    if path.suffix == ".npz":
        stored = stored["positions" if "positions" in stored else "points"]
    if stored.dtype.names:
        return np.stack([stored[axis] for axis in "xyz"], axis=1)
    return stored[:, :3]


def _obj(path: Path) -> list[list[float]]:
    lines = [line.split() for line in path.read_text().splitlines()]
    return [[float(word) for word in words[1:4]] for words in lines if words[:1] == ["v"]]


def _off(path: Path) -> list[list[float]]:
    lines = path.read_text().splitlines()
    return [
        [float(word) for word in line.split()[:3]]
        for line in lines[2 : 2 + int(lines[1].split()[0])]
    ]


def _mesh(path: Path) -> Any:
    import trimesh

    return trimesh.load_scene(path, process=False).to_mesh().vertices


_READERS = {
    ".ply": _ply,
    ".pcd": _pcd,
    ".las": _las,
    ".laz": _las,
    ".e57": _e57,
    ".ptx": _ptx,
    ".npy": _array,
    ".npz": _array,
    ".obj": _obj,
    ".off": _off,
    ".stl": _mesh,
    ".glb": _mesh,
    ".gltf": _mesh,
}
