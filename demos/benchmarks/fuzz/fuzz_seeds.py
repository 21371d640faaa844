"""Small valid files of every format that is read, made here: what the file fuzzer starts from."""

from __future__ import annotations

import base64
import io
import json
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.files.writers import formats

Array = NDArray[Any]

POINTS = 60


def make(folder: Path) -> list[Path]:
    """Write all of them into a folder; what needs a package that is missing is left out."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(POINTS, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    colors = rng.integers(0, 256, (POINTS, 3)).astype(np.uint8)
    cloud = CloudArrays(
        np.round(normals, 4), np.round(normals, 4), {"colors": colors, "intensity": colors[:, :1]}
    )
    made = []
    for makers in (_texts, _scans, _tables, _meshes, _scenes, _las, _e57):
        try:
            contents = dict(makers(cloud))
        except ModuleNotFoundError:
            continue
        for name, data in contents.items():
            made.append(folder / name)
            made[-1].write_bytes(data)
    return made


def _rows(*columns: Array, delimiter: str = " ", fmt: str = "%.4f") -> str:
    stream = io.StringIO()
    np.savetxt(stream, np.hstack(columns), fmt=fmt, delimiter=delimiter)
    return stream.getvalue()


def _texts(cloud: CloudArrays) -> Iterator[tuple[str, bytes]]:
    points, normals = cloud.points, cloud.normals
    assert normals is not None
    colors, plain = cloud.attributes["colors"], _rows(points)
    yield "blanks.xyz", plain.encode()
    yield "commas.csv", ("x,y,z\n" + _rows(points, delimiter=",")).encode()
    yield "semicolons.txt", _rows(points, delimiter=";").replace(".", ",").encode()
    yield "tabs.asc", ("# exported\n" + _rows(points, delimiter="\t")).encode()
    yield "utf16.xyz", plain.encode("utf-16")
    yield "mark.xyz", plain.encode("utf-8-sig")
    yield "count.xyz", f"//X Y Z\n{POINTS}\n{plain}".encode()
    yield "normals.xyzn", _rows(points, normals).encode()
    yield "colors.xyzrgb", _rows(points, colors / 255).encode()
    yield "words.csv", "".join(f"{row} tree\n" for row in plain.splitlines()).encode()


def _scans(cloud: CloudArrays) -> Iterator[tuple[str, bytes]]:
    points, colors = cloud.points, cloud.attributes["colors"]
    gray = colors[:, :1] / 255
    count = f"{POINTS}\n"
    yield "plain.pts", _rows(points).encode()
    yield "leica.pts", (count + _rows(points, gray * 4000 - 2000, colors)).encode()
    yield "several.pts", (count + _rows(points, gray) + count + _rows(-points, gray)).encode()
    pose = "1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 2 3 1\n"
    scan = f"6\n{POINTS // 6}\n{pose}{_rows(points, gray)}"
    yield "one.ptx", scan.encode()
    yield "two.ptx", (scan + scan).encode()


def _tables(cloud: CloudArrays) -> Iterator[tuple[str, bytes]]:
    points, colors = cloud.points, cloud.attributes["colors"]
    for write, ending in ((formats.write_cloud_ply, "ply"), (formats.write_cloud_pcd, "pcd")):
        yield f"ours.{ending}", _written(write, cloud)
    header = f"ply\nformat {{}} 1.0\ncomment seed\nelement vertex {POINTS}\n" + "".join(
        f"property float {axis}\n" for axis in "xyz"
    )
    ascii_faces = "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    yield (
        "ascii.ply",
        (header.format("ascii") + ascii_faces + _rows(points) + "3 0 1 2\n4 3 4 5 6\n").encode(),
    )
    big = header.format("binary_big_endian").encode()
    yield "big.ply", big + b"end_header\n" + points.astype(">f4").tobytes()
    first = b"ply\nformat binary_little_endian 1.0\nelement face 2\n"
    first += b"property list uchar int vertex_index\n"
    faces = struct.pack("<B3iB4i", 3, 0, 1, 2, 4, 3, 4, 5, 6)
    first += header.partition("seed\n")[2].encode() + b"end_header\n" + faces
    yield "faces_first.ply", first + points.astype("<f4").tobytes()
    yield "lists.ply", _ply_with_lists(points)
    fields = "VERSION 0.7\nFIELDS x y z _ rgb\nSIZE 4 4 4 1 4\nTYPE F F F U U\nCOUNT 1 1 1 4 1\n"
    size = f"WIDTH {POINTS // 6}\nHEIGHT 6\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS {POINTS}\n"
    packed = (colors.astype("<u4") << np.array([16, 8, 0], "<u4")).sum(axis=1, dtype="<u4")
    parts = [*points.astype("<f4").T, np.zeros(POINTS, "<u4"), packed]
    records = np.stack([part.view("<u4") for part in parts], axis=1)
    head = fields + size
    yield "binary.pcd", f"{head}DATA binary\n".encode() + records.tobytes()
    flat = records.T.tobytes()
    lzf = _pack_lzf(flat)
    sizes = struct.pack("<II", len(lzf), len(flat))
    yield "packed.pcd", f"{head}DATA binary_compressed\n".encode() + sizes + lzf
    zeros = np.zeros((POINTS, 4))
    rows = _rows(points, zeros, packed[:, np.newaxis], fmt="%.10g")
    yield "ascii.pcd", f"{head}DATA ascii\n{rows}".encode()
    yield "ours.npz", _written(formats.write_cloud_npz, cloud)
    stream = io.BytesIO()
    np.savez_compressed(stream, points=points, normals=cloud.normals, label=np.arange(POINTS))
    yield "deflated.npz", stream.getvalue()
    for name, array in (
        ("plain", points),
        ("named", _structured(points)),
        ("columns", points.T.copy().T),
    ):
        stream = io.BytesIO()
        np.save(stream, array)
        yield f"{name}.npy", stream.getvalue()


def _written(write: Callable[[Any, CloudArrays], None], cloud: CloudArrays) -> bytes:
    stream = io.BytesIO()
    write(stream, cloud)
    return stream.getvalue()


def _structured(points: Array) -> Array:
    named = np.zeros(len(points), [("x", "f8"), ("y", "f8"), ("z", "f8"), ("label", "u1")])
    for i, axis in enumerate("xyz"):
        named[axis] = points[:, i]
    return named


def _ply_with_lists(points: Array) -> bytes:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {POINTS}\n"
    head += "property double x\nproperty double y\nproperty double z\n"
    head += "property list uchar short views\nend_header\n"
    rows = [
        struct.pack(f"<3dB{i % 4}h", *point, i % 4, *range(i % 4)) for i, point in enumerate(points)
    ]
    return head.encode() + b"".join(rows)


def _pack_lzf(data: bytes) -> bytes:
    """Pack by LZF: copies of what was three bytes or more before, the rest as it is."""
    out, plain, seen, at = bytearray(), bytearray(), {}, 0

    def flush() -> None:
        for start in range(0, len(plain), 32):
            piece = plain[start : start + 32]
            out.append(len(piece) - 1)
            out.extend(piece)
        plain.clear()

    while at < len(data):
        key = data[at : at + 3]
        start = seen.get(key, -1)
        seen[key] = at
        length = 0
        while start >= 0 and length < 264 and data[at + length : at + length + 1] == data[
            start + length : start + length + 1
        ] != b"":  # fmt: skip
            length += 1
        distance = at - start - 1
        if length < 3 or distance >= 8192:
            plain.append(data[at])
            at += 1
            continue
        flush()
        code = length - 2
        out.append((min(code, 7) << 5) | (distance >> 8))
        if code >= 7:
            out.append(code - 7)
        out.append(distance & 255)
        at += length
    flush()
    return bytes(out)


def _meshes(cloud: CloudArrays) -> Iterator[tuple[str, bytes]]:
    triangles = np.arange(POINTS).reshape(-1, 3)
    for write, name in (
        (formats.write_mesh_obj, "colors.obj"),
        (formats.write_mesh_off, "colors.off"),
        (formats.write_mesh_stl, "binary.stl"),
        (formats.write_mesh_ply, "mesh.ply"),
    ):
        stream = io.BytesIO()
        write(stream, cloud, triangles)
        yield name, stream.getvalue()
    rows = _rows(cloud.points).splitlines()
    yield "points.obj", "".join(f"v {row}\n" for row in rows).encode()
    yield "points.off", f"OFF\n{POINTS} 0 0\n{_rows(cloud.points)}".encode()
    facet = "facet normal 0 0 1\nouter loop\nvertex {}\nvertex {}\nvertex {}\nendloop\nendfacet\n"
    facets = "".join(facet.format(*rows[i : i + 3]) for i in range(0, POINTS, 3))
    yield "text.stl", f"solid seed\n{facets}endsolid seed\n".encode()


def _scenes(cloud: CloudArrays) -> Iterator[tuple[str, bytes]]:
    points, colors = cloud.points.astype("<f4"), cloud.attributes["colors"]
    padded = np.hstack([colors, np.full((POINTS, 1), 255, np.uint8)])
    corners = np.arange(POINTS, dtype="<u2")
    parts = [points.tobytes(), padded.tobytes(), corners.tobytes()]
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    views = [
        {"buffer": 0, "byteOffset": start, "byteLength": len(part)}
        for start, part in zip(starts, parts, strict=False)
    ]
    contents: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1]}, {"mesh": 0, "translation": [1, 2, 3], "scale": [2, 2, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": POINTS, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5121, "count": POINTS, "type": "VEC4"},
            {"bufferView": 2, "componentType": 5123, "count": POINTS, "type": "SCALAR"},
        ],
        "bufferViews": views,
    }
    data = b"".join(parts)
    address = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    inside = {**contents, "buffers": [{"uri": address, "byteLength": len(data)}]}
    yield "inside.gltf", json.dumps(inside, indent=1).encode()
    text = json.dumps({**contents, "buffers": [{"byteLength": len(data)}]}).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    yield "scene.glb", struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _las(cloud: CloudArrays) -> Iterator[tuple[str, bytes]]:
    import laspy

    for version, kind in (("1.2", 2), ("1.4", 7), ("1.4", 6)):
        header = laspy.LasHeader(version=version, point_format=kind)
        header.scales = [1e-4] * 3
        header.vlrs.append(laspy.VLR("seed", 1, "a record", b"contents"))
        if kind == 7:
            header.add_extra_dims([laspy.ExtraBytesParams("height", "f4")])
        data = laspy.LasData(header)
        data.x, data.y, data.z = cloud.points.T
        if kind != 6:
            data.red, data.green, data.blue = cloud.attributes["colors"].astype("u2").T * 257
        for ending in ("las", "laz"):
            stream = io.BytesIO()
            data.write(stream, do_compress=ending == "laz")
            yield f"format{kind}.{ending}", stream.getvalue()


def with_checksums(data: bytes) -> bytes:
    """Return an E57 with the right checksum at the end of every page: damage gets past them."""
    pages = []
    for start in range(0, len(data) - 1023, 1024):
        page = data[start : start + 1020]
        value = 0xFFFFFFFF
        for byte in page:
            value = (value >> 8) ^ _CASTAGNOLI[(value ^ byte) & 255]
        pages.append(page + struct.pack(">I", value ^ 0xFFFFFFFF))
    return b"".join(pages)


def _castagnoli(value: int) -> int:
    for _ in range(8):
        value = (value >> 1) ^ (0x82F63B78 if value & 1 else 0)
    return value


_CASTAGNOLI = [_castagnoli(value) for value in range(256)]


def _e57(cloud: CloudArrays) -> Iterator[tuple[str, bytes]]:
    import tempfile

    import pye57

    with tempfile.TemporaryDirectory() as folder:
        file = pye57.E57(f"{folder}/two.e57", mode="w")
        columns = {f"cartesian{a}": cloud.points[:, i] for i, a in enumerate("XYZ")}
        for i, name in enumerate(("Red", "Green", "Blue")):
            columns[f"color{name}"] = cloud.attributes["colors"][:, i]
        for place in ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)):
            file.write_scan_raw(
                columns, rotation=np.array([1.0, 0, 0, 0]), translation=np.array(place)
            )
        file.close()
        yield "two.e57", Path(folder, "two.e57").read_bytes()
