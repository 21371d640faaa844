"""PLY, PCD, npy and npz: any types, names, orders and paddings; what is not used is said."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest

from o3d_sofnn.files import point_files, reading

N = 50
RNG = np.random.default_rng(0)
POINTS = RNG.uniform(-5.0, 5.0, (N, 3)).astype(np.float32)
COLORS = RNG.integers(0, 256, (N, 3)).astype(np.uint8)


def read(folder, data, name):
    (folder / name).write_bytes(data)
    return point_files.read_points(folder / name)


def ply(columns, order="<", behind=b"", elements=""):
    """Return a PLY with columns (name, type, values); order "" is ascii."""
    words = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}
    types = {"i1": "char", "u1": "uchar", "i2": "short", "u2": "ushort", "i4": "int"}
    types |= {"u4": "uint", "f4": "float", "f8": "double"}
    head = f"ply\nformat {words[order]} 1.0\ncomment made here\nelement vertex {N}\n"
    head += "".join(f"property {types[kind]} {name}\n" for name, kind, _ in columns)
    head += f"{elements}end_header\n"
    records = np.zeros(N, [(name, (order or "<") + kind) for name, kind, _ in columns])
    for name, _, values in columns:
        records[name] = values
    if order:
        return head.encode() + records.tobytes() + behind
    rows = "".join(" ".join(map(repr, row)) + "\n" for row in records.tolist())
    return head.encode() + rows.encode() + behind


def xyz(kind="f4", values=POINTS):
    return [(axis, kind, values[:, i]) for i, axis in enumerate("xyz")]


@pytest.mark.parametrize("order", ["<", ">", ""])
@pytest.mark.parametrize("kind", ["i1", "u1", "i2", "u2", "i4", "u4", "f4", "f8"])
def test_ply_coordinates_of_any_type(tmp_path, order, kind):
    values = RNG.integers(0, 100, (N, 3)) if kind[0] in "iu" else POINTS
    file = read(tmp_path, ply(xyz(kind, values), order), "a.ply")
    assert np.array_equal(file.points, values)
    assert file.notes == ()


@pytest.mark.parametrize(
    "names", ["red green blue", "r g b", "diffuse_red diffuse_green diffuse_blue"]
)
@pytest.mark.parametrize(
    ("kind", "values", "stored"),
    [
        ("u1", COLORS, np.uint8),
        ("u2", COLORS.astype(np.uint16) * 257, np.uint16),
        ("u2", COLORS.astype(np.uint16), np.uint8),
        ("i4", COLORS.astype(np.int32), np.uint8),
        ("f4", (COLORS / 255).astype(np.float32), np.float32),
        ("f4", COLORS.astype(np.float32), np.uint8),
    ],
)
def test_colours_of_any_name_and_type(tmp_path, names, kind, values, stored):
    columns = [(name, kind, values[:, i]) for i, name in enumerate(names.split())]
    file = read(tmp_path, ply(xyz() + columns), "a.ply")
    assert file.attributes["colors"].dtype == stored
    assert np.array_equal(file.attributes["colors"], values)


def test_colours_out_of_range_are_said(tmp_path):
    columns = [(name, "f4", COLORS[:, i] * 1e5) for i, name in enumerate(("red", "green", "blue"))]
    file = read(tmp_path, ply(xyz() + columns), "a.ply")
    assert set(file.attributes) == {"red", "green", "blue"}
    assert "no known range" in file.notes[0]


def test_gaussian_splats_have_colours(tmp_path):
    shares = np.array([0.0, 0.25, 1.0])
    terms = np.tile((shares - 0.5) * 2 * np.sqrt(np.pi), (N, 1))
    columns = [(f"f_dc_{i}", "f4", terms[:, i]) for i in range(3)] + [("opacity", "f4", 0.5)]
    file = read(tmp_path, ply(xyz() + columns), "a.ply")
    assert np.allclose(file.attributes["colors"], shares, atol=1e-6)
    assert np.array_equal(file.attributes["opacity"], np.full((N, 1), 0.5))


def test_ply_with_faces_before_and_lists_in_the_points(tmp_path):
    head = b"ply\nformat binary_little_endian 1.0\nelement face 2\n"
    head += b"property list uchar int vertex_index\n"
    faces = struct.pack("<B3iB4i", 3, 0, 1, 2, 4, 3, 4, 5, 6)
    body = ply(xyz()).split(b"here\n")[1]
    header, _, rows = body.partition(b"end_header\n")
    file = read(tmp_path, head + header + b"end_header\n" + faces + rows, "a.ply")
    assert np.array_equal(file.points, POINTS)
    _, triangles = reading.read_triangles(tmp_path / "a.ply")
    assert triangles.tolist() == [[0, 1, 2], [3, 4, 5], [3, 5, 6]]

    header = header.replace(b"float z\n", b"float z\nproperty list uchar short seen\n")
    rows = b"".join(
        struct.pack(f"<3fB{i % 3}h", *point, i % 3, *range(i % 3)) for i, point in enumerate(POINTS)
    )
    plain = b"ply\nformat binary_little_endian 1.0\n" + header + b"end_header\n" + rows
    file = read(tmp_path, plain, "b.ply")
    assert np.array_equal(file.points, POINTS)
    assert file.notes == ("vertex property seen left out: a list",)


@pytest.mark.parametrize("order", ["<", ""])
def test_ply_of_pcl_says_where_the_scanner_stood(tmp_path, order):
    elements = "element camera 1\n" + "".join(f"property float view_p{a}\n" for a in "xyz")
    behind = struct.pack("<3f", 1, 2, 3) if order else b"1 2 3\n"
    file = read(tmp_path, ply(xyz(), order, behind, elements), "a.ply")
    assert np.array_equal(file.viewpoint, [1.0, 2.0, 3.0])
    behind = struct.pack("<3f", 0, 0, 0) if order else b"0 0 0\n"
    assert read(tmp_path, ply(xyz(), order, behind, elements), "b.ply").viewpoint is None


FIELDS = [("x", "f4", 1), ("y", "f8", 1), ("z", "f4", 1), ("_", "u1", 3), ("label", "u2", 1)]
FIELDS += [("_", "u1", 5), ("hist", "f4", 4), ("rgb", "f4", 1), ("normal_x", "f4", 1)]
FIELDS += [("normal_y", "f4", 1), ("normal_z", "f4", 1)]


def pcd_records():
    records = np.zeros(
        N, [(str(i), f"<{kind}", (count,)) for i, (_, kind, count) in enumerate(FIELDS)]
    )
    for i in range(3):
        records[str(i)][:, 0] = POINTS[:, i]
        records[str(8 + i)][:, 0] = POINTS[:, i]
    records["4"][:, 0] = np.arange(N) * 1000
    records["6"] = RNG.random((N, 4))
    packed = COLORS.astype("<u4") @ np.array([65536, 256, 1], "<u4")
    records["7"][:, 0] = packed.view("<f4")
    return records


def pcd(data, body, viewpoint="0 0 0 1 0 0 0", size=(N, 1), points=N):
    names, kinds, counts = zip(*FIELDS, strict=True)
    head = f"# .PCD v0.7\nVERSION 0.7\nFIELDS {' '.join(names)}\n"
    head += f"SIZE {' '.join(kind[1] for kind in kinds)}\n"
    head += (
        f"TYPE {' '.join(kind[0].upper() for kind in kinds)}\nCOUNT {' '.join(map(str, counts))}\n"
    )
    head += (
        f"WIDTH {size[0]}\nHEIGHT {size[1]}\nVIEWPOINT {viewpoint}\nPOINTS {points}\nDATA {data}\n"
    )
    return head.encode() + body


def pcd_body(data, records):
    if data == "binary":
        return records.tobytes()
    if data == "ascii":
        rows = [[value for part in row for value in part.tolist()] for row in records.tolist()]
        return "".join(" ".join(map(repr, row)) + "\n" for row in rows).encode()
    flat = b"".join(np.ascontiguousarray(records[name]).tobytes() for name in records.dtype.names)
    # Runs of bytes as they are, and three copies that reach into themselves.
    packed = b"".join(
        bytes([len(flat[i : i + 32]) - 1]) + flat[i : i + 32] for i in range(0, len(flat), 32)
    )
    return struct.pack("<II", len(packed), len(flat)) + packed


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_pcd_with_padding_and_fields_of_any_type(tmp_path, data):
    records = pcd_records()
    file = read(tmp_path, pcd(data, pcd_body(data, records), size=(N // 5, 5)), "a.pcd")
    assert np.array_equal(file.points, POINTS)
    assert np.array_equal(file.normals, POINTS)
    assert np.array_equal(file.attributes["colors"], COLORS)
    assert np.array_equal(file.attributes["label"], records["4"])
    assert np.array_equal(file.attributes["hist"], records["6"])
    assert set(file.attributes) == {"colors", "label", "hist"}
    assert file.shape == (5, N // 5)
    assert file.viewpoint is None


def test_lzf_copies_what_was_before(tmp_path):
    flat = np.zeros(N, [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]).tobytes()
    head = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    head += f"WIDTH {N}\nHEIGHT 1\nPOINTS {N}\nDATA binary_compressed\n"
    packed = bytes([0, 0]) + bytes([0xE0, 255, 0]) * 2 + bytes([0xE0, 600 - 1 - 2 * 264 - 9, 0])
    body = struct.pack("<II", len(packed), len(flat)) + packed
    assert not read(tmp_path, head.encode() + body, "a.pcd").points.any()
    for wrong in (packed[:-1], packed + b"\0\0", b"\x20\1" + packed[2:], packed[:2] + b"\xff"):
        body = struct.pack("<II", len(wrong), len(flat)) + wrong
        with pytest.raises(ValueError, match=r"damaged|cut short"):
            read(tmp_path, head.encode() + body, "b.pcd")


def test_pcd_says_where_the_scanner_stood(tmp_path):
    body = pcd_body("binary", pcd_records())
    file = read(tmp_path, pcd("binary", body, viewpoint="1 -2 3.5 0.7 0.7 0 0"), "a.pcd")
    assert np.array_equal(file.viewpoint, [1.0, -2.0, 3.5])


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
@pytest.mark.parametrize("more", [1, 10**6, 2**31 - 1, 2**62 // N])
def test_pcd_with_fewer_points_than_it_says(tmp_path, data, more):
    body = pcd_body(data, pcd_records())
    size, points = ((N + 1, 1), N + 1) if more == 1 else ((N, more), N * more)
    with pytest.raises(ValueError, match=r"a\.pcd: (cut short|not readable)"):
        read(tmp_path, pcd(data, body, size=size, points=points), "a.pcd")


def test_pcd_with_sizes_that_differ(tmp_path):
    body = pcd_body("binary", pcd_records())
    with pytest.raises(ValueError, match="POINTS"):
        read(tmp_path, pcd("binary", body, points=N - 1), "a.pcd")


@pytest.mark.parametrize("name", ["positions", "points", "whatever"])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("kind", ["f2", "f4", ">f8", "i8", "g"])
def test_npz_with_any_one_array_of_coordinates(tmp_path, name, order, kind):
    values = np.asarray(POINTS.round(1), dtype=kind, order=order)
    stream = io.BytesIO()
    np.savez_compressed(
        stream, **{name: values, "label": np.arange(N), "odd": 3, "text": ["a"] * N}
    )
    file = read(tmp_path, stream.getvalue(), "a.npz")
    assert np.array_equal(file.points, values.astype(float))
    assert np.array_equal(file.attributes["label"][:, 0], np.arange(N))
    assert [note.split()[0] for note in file.notes] == ["'odd'", "'text'"]
    stream = io.BytesIO()
    np.save(stream, values)
    assert np.array_equal(read(tmp_path, stream.getvalue(), "a.npy").points, values.astype(float))


def test_npz_without_or_with_two_arrays_of_coordinates(tmp_path):
    for arrays in ({"a": np.zeros((N, 4))}, {"a": POINTS, "b": POINTS}):
        stream = io.BytesIO()
        np.savez(stream, **arrays)
        with pytest.raises(ValueError, match="one array of shape"):
            read(tmp_path, stream.getvalue(), "a.npz")


def test_structured_npy(tmp_path):
    named = np.zeros(N, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "u2"), ("red", "u1")])
    for i, axis in enumerate("xyz"):
        named[axis] = POINTS[:, i]
    named["intensity"] = np.arange(N)
    stream = io.BytesIO()
    np.save(stream, named)
    file = read(tmp_path, stream.getvalue(), "a.npy")
    assert np.array_equal(file.points, POINTS)
    assert np.array_equal(file.attributes["intensity"][:, 0], np.arange(N))
    assert set(file.attributes) == {"intensity", "red"}
