"""glTF 2.0 and GLB: vertices of all meshes in the scene, placed by their nodes."""

from __future__ import annotations

import base64
import json
import urllib.parse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.files import triangles
from o3d_sofnn.files.columns import Array, PointFile
from o3d_sofnn.files.regular import NotRegularError, bytes_left, open_regular, too_large
from o3d_sofnn.files.triangles import Triangles

_TYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


_MAGIC, _JSON, _BINARY = b"glTF", b"JSON", b"BIN\0"


_POINTS, _TRIANGLES, _STRIP, _FAN = 0, 4, 5, 6


_DEEPEST = 100  # nodes deeper in each other are in a circle


class _Fault(Exception):
    """What is wrong with the file; in words, without its name."""


def read_gltf(path: Path) -> PointFile:
    """Read vertices, and normals and colours where all meshes have them.

    Raises
    ------
    OSError
        The file, or one that it refers to, cannot be opened.
    ValueError
        The file is not glTF 2.0, compressed, or cut short; the message names it.
    """
    parts = _read(path)
    notes = []
    normals = None
    if parts and all(part.normals is not None for part in parts):
        normals = np.concatenate([part.normals for part in parts if part.normals is not None])
    attributes = {}
    colors = [part.colors for part in parts if part.colors is not None]
    if colors and len(colors) == len(parts):
        if len({part.dtype for part in colors}) > 1:
            full = [np.iinfo(p.dtype).max if p.dtype.kind == "u" else 1.0 for p in colors]
            colors = [part / most for part, most in zip(colors, full, strict=True)]
        attributes["colors"] = np.concatenate(colors)
    elif colors:
        notes.append("colours left out: some meshes have none")
    others = sorted({name for part in parts for name in part.others})
    if others:
        notes.append(f"vertex attributes left out: {' '.join(others)}")
    return PointFile(_points(parts), normals, attributes, notes=tuple(notes))


def read_gltf_mesh(path: Path) -> tuple[Array, Triangles]:
    """Read the (m, 3) vertices and the (f, 3) triangles."""
    parts = _read(path)
    found, start = [np.zeros((0, 3), dtype=np.int64)], 0
    for part in parts:
        found.append(triangles.checked(part.triangles(), len(part.points), path) + start)
        start += len(part.points)
    return _points(parts), np.concatenate(found)


class _Part:
    """A primitive of a mesh, in the coordinates of the scene."""

    def __init__(self, file: _File, primitive: dict[str, Any], transform: Array) -> None:
        attributes = primitive["attributes"]
        if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
            raise _Fault("compressed by Draco")
        self.points = file.vectors(attributes["POSITION"]) @ transform[:3, :3].T + transform[:3, 3]
        self.normals: Array | None = None
        if "NORMAL" in attributes:
            # Normals of a mesh that is stretched turn with its cofactors.
            turned = file.vectors(attributes["NORMAL"]) @ _cofactors(transform[:3, :3]).T
            length = np.linalg.norm(turned, axis=1, keepdims=True)
            self.normals = np.divide(turned, length, out=np.zeros_like(turned), where=length > 0)
        self.colors = file.colors(attributes["COLOR_0"]) if "COLOR_0" in attributes else None
        for values in (self.normals, self.colors):
            if values is not None and len(values) != len(self.points):
                raise _Fault("attributes of different lengths")
        self.others = attributes.keys() - {"POSITION", "NORMAL", "COLOR_0"}
        self._mode = primitive.get("mode", _TRIANGLES)
        self._corners = np.arange(len(self.points))
        if "indices" in primitive and self._mode in (_TRIANGLES, _STRIP, _FAN):
            self._corners = file.accessor(primitive["indices"])[:, 0].astype(np.int64)

    def triangles(self) -> NDArray[np.int64]:
        """Return the corners, three by three."""
        corners = self._corners
        if self._mode == _TRIANGLES:
            return corners[: len(corners) // 3 * 3].reshape(-1, 3)
        if self._mode == _FAN and len(corners) > 2:
            return triangles.from_polygons(np.array([len(corners)]), corners)
        if self._mode == _STRIP and len(corners) > 2:
            strip = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
            strip[1::2] = strip[1::2, ::-1]
            return strip
        return np.zeros((0, 3), dtype=np.int64)


class _File:
    """The JSON of a file, and its buffers, read when they are needed."""

    def __init__(self, path: Path, contents: dict[str, Any], binary: bytes | None) -> None:
        self.contents = contents
        self._path = path
        self._buffers: dict[int, bytes] = {} if binary is None else {0: binary}

    @property
    def size(self) -> int:
        """Bytes read so far."""
        return sum(map(len, self._buffers.values()))

    def accessor(self, index: int) -> NDArray[Any]:
        """Return the (n, k) values of an accessor."""
        accessor = _at(self.contents["accessors"], index)
        if "sparse" in accessor or "bufferView" not in accessor:
            raise _Fault("an accessor without values of its own")
        count, kind = _natural(accessor["count"]), np.dtype(_TYPES[accessor["componentType"]])
        width = _WIDTHS[accessor["type"]]
        offset = _natural(accessor.get("byteOffset", 0))
        return self._view(accessor["bufferView"], offset, (count, width), kind)

    def vectors(self, index: int) -> Array:
        """Return the (n, 3) values of an accessor as shares of one where they are normalised."""
        values = self.accessor(index)
        if values.shape[1] != 3:
            raise _Fault("coordinates of other than three numbers")
        if _at(self.contents["accessors"], index).get("normalized") and values.dtype.kind in "iu":
            return np.maximum(values / np.iinfo(values.dtype).max, -1.0)
        return values.astype(np.float64)

    def colors(self, index: int) -> NDArray[Any]:
        """Return the (n, 3) colours, without opacity."""
        values = self.accessor(index)
        if values.shape[1] not in (3, 4) or values.dtype.str[1:] not in ("u1", "u2", "f4"):
            raise _Fault("colours of an unknown type")
        return np.ascontiguousarray(values[:, :3])

    def _view(
        self, index: int, offset: int, shape: tuple[int, int], kind: np.dtype[Any]
    ) -> NDArray[Any]:
        count, width = shape
        view = _at(self.contents["bufferViews"], index)
        start, length = _natural(view.get("byteOffset", 0)), _natural(view["byteLength"])
        data = self._buffer(view["buffer"])
        size = width * kind.itemsize
        stride = _natural(view.get("byteStride", size))
        end = offset + (count - 1) * stride + size if count else 0
        if stride < size or end > length or start + length > len(data):
            raise _Fault("an accessor beyond the end of its buffer")
        if count == 0:
            return np.zeros(shape, kind)
        return np.ndarray(shape, kind, data, start + offset, (stride, kind.itemsize))

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            buffer = _at(self.contents["buffers"], index)
            if "uri" not in buffer:
                raise _Fault("a buffer without contents")
            self._buffers[index] = self._fetch(buffer["uri"], _natural(buffer["byteLength"]))
        return self._buffers[index]

    def _fetch(self, uri: str, length: int) -> bytes:
        """Return the bytes of an address: data within it, or a file beside the file."""
        head, comma, data = uri.partition(",")
        if head.startswith("data:"):
            if not comma or not head.endswith(";base64"):
                raise _Fault("data in another form than base64")
            return base64.b64decode(data, validate=True)
        name = Path(urllib.parse.unquote(uri))
        if urllib.parse.urlsplit(uri).scheme or name.is_absolute() or ".." in name.parts:
            raise _Fault("a buffer elsewhere than beside the file")
        with open_regular(self._path.parent / name) as stream:
            return stream.read(min(length, bytes_left(stream)))


def _read(path: Path) -> list[_Part]:
    parts: list[_Part] = []
    size = 0
    try:
        contents, binary = _read_json(path)
        if not contents["asset"]["version"].startswith("2."):
            raise _Fault("another version than 2")
        file = _File(path, contents, binary)
        for primitive, transform in _primitives(contents):
            parts.append(_Part(file, primitive, transform))
            size += parts[-1].points.nbytes
            # A mesh may be in many places.
            if too_large(size, file.size):
                raise _Fault(f"{size} bytes of points out of {file.size}")
        return parts
    except NotRegularError:
        raise
    except _Fault as fault:
        raise ValueError(f"{path}: not readable as glTF: {fault}") from None
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError) as error:
        # JSON may hold anything in any place.
        text = " ".join(str(error).split())[:100]
        raise ValueError(f"{path}: not readable as glTF: {type(error).__name__} {text}") from error


def _read_json(path: Path) -> tuple[dict[str, Any], bytes | None]:
    """Return the JSON part, and the binary one of a GLB."""
    with open_regular(path) as stream:
        data = stream.read()
    if not data.startswith(_MAGIC):
        return json.loads(data.decode("utf-8-sig")), None
    chunks: dict[bytes, bytes] = {}
    at, end = 12, int.from_bytes(data[8:12], "little")
    if end > len(data):
        raise _Fault(f"cut short: it says {end} bytes, it has {len(data)}")
    while at + 8 <= end:
        length = int.from_bytes(data[at : at + 4], "little")
        if at + 8 + length > end:
            raise _Fault("a part beyond the end of the file")
        chunks.setdefault(data[at + 4 : at + 8], data[at + 8 : at + 8 + length])
        at += 8 + length
    return json.loads(chunks[_JSON].decode()), chunks.get(_BINARY)


def _primitives(contents: dict[str, Any]) -> Iterator[tuple[dict[str, Any], Array]]:
    """Yield primitives with the transformation into the scene, in the order of its nodes."""
    meshes, nodes = contents.get("meshes", []), contents.get("nodes", [])
    if not nodes:
        for mesh in meshes:
            for primitive in mesh["primitives"]:
                yield primitive, np.eye(4)
        return
    scenes = contents.get("scenes", [])
    children = {child for node in nodes for child in node.get("children", [])}
    roots = [i for i in range(len(nodes)) if i not in children]
    if scenes:
        roots = _at(scenes, contents.get("scene", 0)).get("nodes", [])
    left = [(root, np.eye(4), 0) for root in reversed(roots)]
    seen = 0
    while left:
        index, above, depth = left.pop()
        seen += 1
        # Every node has one parent.
        if depth > _DEEPEST or seen > len(nodes):
            raise _Fault("nodes in a circle")
        node = _at(nodes, index)
        transform = above @ _transform(node)
        if "mesh" in node:
            for primitive in _at(meshes, node["mesh"])["primitives"]:
                yield primitive, transform
        left += [(child, transform, depth + 1) for child in reversed(node.get("children", []))]


def _transform(node: dict[str, Any]) -> Array:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    transform = np.eye(4)
    transform[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    transform[:3, 3] = node.get("translation", (0, 0, 0))
    return transform


def _cofactors(matrix: Array) -> Array:
    a, b, c = matrix
    return np.array([np.cross(b, c), np.cross(c, a), np.cross(a, b)])


def _points(parts: list[_Part]) -> Array:
    return np.concatenate([np.zeros((0, 3)), *(part.points for part in parts)])


def _at(items: list[Any], index: int) -> Any:
    return items[_natural(index)]


def _natural(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 2**62:
        raise _Fault(f"a number that should count: {str(value)[:40]!r}")
    return value
