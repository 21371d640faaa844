"""Files as users hold them, made here: exports of programs, and what only looks like a scan."""

from __future__ import annotations

import gzip
import io
import json
import pickle
import struct
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).with_name("fuzz")))
import fuzz_seeds

from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.files.writers import glb

Array = NDArray[Any]

COUNT = 200
UTM = np.array([509_000.0, 5_155_000.0, 380.0])
WKT = 'PROJCS["UTM 32N",GEOGCS["WGS 84",DATUM["WGS_1984"]],UNIT["metre",1]]'


def make(folder: Path) -> list[Path]:
    """Write all of them into a folder, those of the file fuzzer too; return their paths."""
    made = fuzz_seeds.make(folder)
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(COUNT, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points, levels = np.round(normals, 4), rng.integers(0, 256, (COUNT, 3))
    for maker in (_texts, _odd_texts, _plys, _pcds, _arrays, _meshes, _las, _not_scans):
        for name, data in maker(points, levels):
            made.append(folder / name)
            made[-1].write_bytes(data if isinstance(data, bytes) else data.encode())
    return made


def rows(*columns: Array, fmt: str = "%.4f", delimiter: str = " ") -> str:
    """Return lines of numbers."""
    stream = io.StringIO()
    np.savetxt(stream, np.hstack(columns), fmt=fmt, delimiter=delimiter)
    return stream.getvalue()


def _texts(points: Array, levels: Array) -> Iterator[tuple[str, str | bytes]]:
    plain, far = rows(points), rows(points + UTM)
    yield "utm.xyz", far
    yield "windows_lines.xyz", plain.replace("\n", "\r\n")
    yield "no_last_newline.xyz", plain.rstrip()
    yield "blank_lines.xyz", plain.replace("\n", "\n\n")
    yield "comment_at_end.xyz", plain + "# end of scan\n"
    yield "exponents.xyz", rows(points, fmt="%.6e")
    yield "levels_behind.xyz", rows(points, levels)
    yield "normals_behind.txt", rows(points, points, fmt="%.7f")
    yield "intensity.txt", rows(points, levels[:, :1] / 255)
    ids = np.arange(COUNT)[:, np.newaxis]
    yield "index_column.csv", "id,x,y,z\n" + rows(ids, points, delimiter=",")
    yield "quoted_names.csv", '"x","y","z"\n' + rows(points, delimiter=",")
    paraview = '"Normals:0","Normals:1","Normals:2","Points:0","Points:1","Points:2"\n'
    yield "paraview.csv", paraview + rows(points, points, delimiter=",", fmt="%.7f")
    yield "survey.csv", "Easting,Northing,Elevation\n" + rows(points + UTM, delimiter=",")
    german = "X;Y;Z;Intensität\n" + rows(points, levels[:, :1], delimiter=";").replace(".", ",")
    yield "german_utf8.csv", german
    yield "german_latin1.csv", german.encode("latin-1")
    nan = points.copy()
    nan[::10] = np.nan
    yield "nan_rows.xyz", rows(nan)


def _odd_texts(points: Array, levels: Array) -> Iterator[tuple[str, str | bytes]]:
    plain = rows(points)
    yield "fortran.xyz", rows(points, fmt="%.4e").replace("e", "D")
    yield "cut_in_a_number.xyz", plain[:-4]
    yield "two_columns.xyz", rows(points[:, :2])
    yield "uneven.xyz", plain + "1 2\n"
    yield "words.txt", "Dear customer,\nthe scan is attached.\n"
    yield "thousands.csv", "x;y;z\n509.698,019;5.155.486,725;381,127\n"
    yield "empty.xyz", ""
    yield "count_too_high.pts", f"{COUNT + 5}\n{plain}"


def _ply_head(kind: str, properties: str, count: int = COUNT) -> str:
    return f"ply\nformat {kind} 1.0\nelement vertex {count}\n{properties}end_header\n"


def _properties(names: str, kind: str = "float") -> str:
    return "".join(f"property {kind} {name}\n" for name in names.split())


def _plys(points: Array, levels: Array) -> Iterator[tuple[str, str | bytes]]:
    xyz, rgb = _properties("x y z"), _properties("red green blue", "uchar")
    single = points.astype("<f4")
    yield "utm_ascii.ply", _ply_head("ascii", _properties("x y z", "double")) + rows(points + UTM)
    ascii_file = _ply_head("ascii", xyz + rgb) + rows(points, levels, fmt="%g")
    yield "windows_lines.ply", ascii_file.replace("\n", "\r\n")
    records = np.hstack([single.view("u1"), levels.astype("u1"), np.full((COUNT, 1), 255, "u1")])
    opaque = _ply_head("binary_little_endian", xyz + rgb + _properties("alpha", "uchar"))
    yield "alpha.ply", opaque.encode() + records.tobytes()
    scalar = np.hstack([single, levels[:, :1].astype("<f4")])
    head = _ply_head("binary_little_endian", xyz + _properties("scalar_Intensity"))
    yield (
        "cloudcompare.ply",
        head.replace("1.0\n", "1.0\ncomment made\n", 1).encode() + (scalar.tobytes()),
    )
    nan = single.copy()
    nan[3] = np.nan
    whole = _ply_head("binary_little_endian", xyz).encode() + single.tobytes()
    yield "nan_row.ply", _ply_head("binary_little_endian", xyz).encode() + nan.tobytes()
    yield "cut.ply", whole[:-100]
    yield "no_vertices.ply", _ply_head("ascii", xyz, 0)
    yield "faces_only.ply", "ply\nformat ascii 1.0\nelement face 0\nend_header\n"
    yield "renamed_text.ply", rows(points)
    yield "scan.ply.gz", gzip.compress(whole, mtime=0)


def _pcds(points: Array, levels: Array) -> Iterator[tuple[str, str | bytes]]:
    head = "VERSION .7\nFIELDS x y z intensity\nSIZE {0} {0} {0} 4\nTYPE F F F F\nCOUNT 1 1 1 1\n"
    tail = f"WIDTH {COUNT}\nHEIGHT 1\nPOINTS {COUNT}\nDATA "
    kind = [("points", "<f8", 3), ("intensity", "<f4")]
    records = np.zeros(COUNT, kind)
    records["points"], records["intensity"] = points + UTM, levels[:, 0]
    yield "utm_double.pcd", (head.format(8) + tail + "binary\n").encode() + records.tobytes()
    yield "cut.pcd", (head.format(8) + tail + "binary\n").encode() + records[:-9].tobytes()
    nan = points.copy()
    nan[::7] = np.nan
    yield "nan_rows.pcd", head.format(4) + tail + "ascii\n" + rows(nan, levels[:, :1])


def _saved(array: Array, **options: Any) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, **options)
    return stream.getvalue()


def _arrays(points: Array, levels: Array) -> Iterator[tuple[str, str | bytes]]:
    yield "float32.npy", _saved(points.astype("f4"))
    yield "homogeneous.npy", _saved(np.hstack([points, np.ones((COUNT, 1))]))
    yield "objects.npy", _saved(np.array([{"a": 1}] * 5, dtype=object), allow_pickle=True)
    yield "pickle.npy", pickle.dumps(points)


def _meshes(points: Array, levels: Array) -> Iterator[tuple[str, str | bytes]]:
    lines = [f"v {line}" for line in rows(points, levels / 255).splitlines()]
    yield "colours.obj", "\n".join([*lines, "f -3 -2 -1", ""])
    solid = b"solid by a program that writes this in binary files too".ljust(80)
    facets = np.zeros(COUNT // 3, [("normal", "<f4", 3), ("v", "<f4", (3, 3)), ("zero", "<u2")])
    facets["v"] = points[: COUNT // 3 * 3].reshape(-1, 3, 3)
    yield "solid_binary.stl", solid + struct.pack("<I", len(facets)) + facets.tobytes()
    stream = io.BytesIO()
    cloud = CloudArrays(points + UTM, points, {"colors": levels.astype("u1")})
    glb.write_mesh_glb(stream, cloud, np.arange(COUNT // 3 * 3).reshape(-1, 3))
    yield "utm.glb", stream.getvalue()
    yield "cut.glb", stream.getvalue()[:-50]
    primitive = {"attributes": {"POSITION": 0}, "extensions": {"KHR_draco_mesh_compression": {}}}
    yield (
        "draco.gltf",
        json.dumps({"asset": {"version": "2.0"}, "meshes": [{"primitives": [primitive]}]}),
    )


def _las(points: Array, levels: Array) -> Iterator[tuple[str, str | bytes]]:
    try:
        import laspy
    except ModuleNotFoundError:
        return
    header = laspy.LasHeader(version="1.4", point_format=7)
    header.offsets, header.scales = UTM, [1e-4] * 3
    header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(WKT))
    header.global_encoding.wkt = True
    header.add_extra_dims([laspy.ExtraBytesParams("Amplitude", "f4")])
    data = laspy.LasData(header)
    data.x, data.y, data.z = (points + UTM).T
    data.red, data.green, data.blue = levels.T
    for ending in ("las", "laz"):
        stream = io.BytesIO()
        data.write(stream, do_compress=ending == "laz")
        yield f"utm.{ending}", stream.getvalue()
        yield f"cut.{ending}", stream.getvalue()[:-200]
        stream = io.BytesIO()
        laspy.LasData(laspy.LasHeader(version="1.2", point_format=0)).write(
            stream, do_compress=ending == "laz"
        )
        yield f"no_points.{ending}", stream.getvalue()


def _not_scans(points: Array, levels: Array) -> Iterator[tuple[str, str | bytes]]:
    pointer = "version https://git-lfs.github.com/spec/v1\noid sha256:0123\nsize 123456\n"
    page = "<!DOCTYPE html><html><body>404 Not Found</body></html>\n"
    for ending in ("ply", "xyz", "las", "e57"):
        yield f"lfs_pointer.{ending}", pointer
        yield f"error_page.{ending}", page
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(zipfile.ZipInfo("scan.xyz"), rows(points))
    yield "archive.las", stream.getvalue()
    yield "archive.zip", stream.getvalue()
    yield "registered.rcp", b"\0" * 64
    yield "project.pcap", b"\xd4\xc3\xb2\xa1" + b"\0" * 60
