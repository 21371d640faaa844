"""OBJ, OFF, STL, glTF: vertices in double, with or without faces, as Open3D and by hand."""

from __future__ import annotations

import base64
import json
import struct

import numpy as np
import pytest

from o3d_sofnn.files import point_files, reading

UTM = np.array([5e5, 4.9e6, 100.0])
POINTS = UTM + np.random.default_rng(0).uniform(0.0, 0.01, (30, 3)).round(6)


def write(folder, name, text):
    (folder / name).write_text(text)
    return folder / name


def rows(points, start="", behind=None):
    tails = [""] * len(points) if behind is None else [" " + " ".join(map(str, b)) for b in behind]
    return "".join(
        f"{start}{' '.join(map(repr, p))}{tail}\n"
        for p, tail in zip(points.tolist(), tails, strict=True)
    )


def test_vertices_alone_keep_every_digit(tmp_path):
    obj = point_files.read_points(write(tmp_path, "a.obj", "# made by hand\n" + rows(POINTS, "v ")))
    off = point_files.read_points(
        write(tmp_path, "a.off", "OFF\n# by hand\n30 0 0\n" + rows(POINTS))
    )
    one = point_files.read_points(write(tmp_path, "b.off", "OFF 30 0 0\n\n" + rows(POINTS)))
    for file in (obj, off, one):
        assert np.array_equal(file.points, POINTS)
        assert file.notes == ()


def test_colours_of_off_and_obj(tmp_path):
    colors = np.random.default_rng(1).integers(0, 256, (30, 4))
    for head in ("COFF", "OFF"):
        file = point_files.read_points(
            write(tmp_path, "a.off", f"{head}\n30 0 0\n" + rows(POINTS, behind=colors.tolist()))
        )
        assert np.array_equal(file.attributes["colors"], colors[:, :3])
    shares = (colors[:, :3] / 255).round(6)
    file = point_files.read_points(
        write(tmp_path, "a.obj", rows(POINTS, "v ", behind=shares.tolist()))
    )
    assert np.array_equal(file.attributes["colors"], shares)


def test_obj_normals_of_vertices_and_of_corners(tmp_path):
    normals = np.random.default_rng(1).normal(size=(30, 3)).round(6)
    body = rows(POINTS, "v ") + rows(normals, "vn ")
    own = write(tmp_path, "a.obj", body + "f 1//1 2//2 3//3\nf -30//-30 5//5 6//6\n")
    assert np.array_equal(point_files.read_points(own).normals, normals)
    corners = write(tmp_path, "b.obj", body + "f 1//2 2//2 3//3\n")
    file = point_files.read_points(corners)
    assert file.normals is None
    assert file.notes == ("normals left out: they belong to corners of faces",)


def test_obj_faces_and_statements(tmp_path):
    text = "mtllib none.mtl\n" + rows(POINTS, "v ") + "vt 0 0\nusemtl m\ng a\ns off\n"
    text += "f 1 2 3\nf 4/1 5/1 6/1 7/1\nf -3 -2 -1\nf 1 2 \\\n 4\n"
    path = write(tmp_path, "a.obj", text)
    assert point_files.read_points(path).notes == ()
    points, triangles = reading.read_triangles(path)
    assert np.array_equal(points, POINTS)
    expected = [[0, 1, 2], [3, 4, 5], [3, 5, 6], [27, 28, 29], [0, 1, 3]]
    assert triangles.tolist() == expected
    damaged = write(tmp_path, "b.obj", text + "w 1 2 3\n")
    assert point_files.read_points(damaged).notes == (
        "lines left out, which are no statements of OBJ: 'w'",
    )
    for face in ("f 1 2 31", "f 0 1 2", "f 1 2 x", "f 1 2 -99"):
        with pytest.raises(ValueError, match=r"c\.obj: "):
            reading.read_triangles(write(tmp_path, "c.obj", text + face + "\n"))


@pytest.mark.parametrize("ending", [".obj", ".off", ".stl", ".ply", ".glb"])
def test_the_triangles_are_those_that_open3d_wrote(tmp_path, ending):
    o3d = pytest.importorskip("open3d")
    mesh = o3d.geometry.TriangleMesh.create_torus(radial_resolution=12, tubular_resolution=8)
    mesh.compute_vertex_normals()
    path = tmp_path / f"a{ending}"
    assert o3d.io.write_triangle_mesh(str(path), mesh)
    points, triangles = reading.read_triangles(path)
    corners = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]
    assert np.allclose(points[triangles], corners, atol=1e-5)
    assert len(points) == len(mesh.vertices)
    assert len(point_files.read_points(path).points) == len(mesh.vertices)


def test_stl_as_text(tmp_path):
    facet = "facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex {} 0 0\n  vertex 0 1 0\n"
    facet += " endloop\nendfacet\n"
    whole = "solid a\n" + facet.format(1) + facet.format(500000.125) + "endsolid a\n"
    points, triangles = reading.read_triangles(write(tmp_path, "a.stl", whole))
    assert points.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [500000.125, 0, 0]]
    assert triangles.tolist() == [[0, 1, 2], [0, 3, 2]]
    for bad in (
        whole[:-12],
        whole.replace("vertex 1 0 0", "vertex 1 0"),
        whole.replace("endloop", "", 1),
    ):
        with pytest.raises(ValueError, match=r"b\.stl: "):
            point_files.read_points(write(tmp_path, "b.stl", bad))


FBX = """; FBX 7.3.0 project file
FBXHeaderExtension:  {
    FBXHeaderVersion: 1003
    FBXVersion: 7300
}
Objects:  {
    Geometry: 1000, "Geometry::", "Mesh" {
        Vertices: *12 {
            a: 0,0,0,1,0,0,0,1,0,0,0,1
        }
        PolygonVertexIndex: *12 {
            a: 0,2,-2,0,1,-4,1,2,-4,0,3,-3
        }
    }
    Model: 2000, "Model::tetrahedron", "Mesh" {
        Version: 232
    }
}
Connections:  {
    C: "OO",2000,0
    C: "OO",1000,2000
}
"""


def test_fbx_through_open3d(tmp_path):
    pytest.importorskip("open3d")
    points, triangles = reading.read_triangles(write(tmp_path, "a.fbx", FBX))
    assert sorted(points.tolist()) == [[0, 0, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0]]
    expected = {(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)}
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    assert {
        tuple((points[t, np.newaxis] == corners).all(2).argmax(1)) for t in triangles
    } == expected
    with pytest.raises(ValueError, match=r"b\.fbx: not readable: no vertices"):
        point_files.read_points(write(tmp_path, "b.fbx", "nonsense"))


def gltf(parts, nodes, primitive=None, **more):
    """Return the contents of a glTF; parts are (values, accessor's further entries)."""
    views, accessors, data = [], [], b""
    types = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
    kinds = {"f4": 5126, "u1": 5121, "u2": 5123, "i2": 5122}
    for values, entries in parts:
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": values.nbytes})
        accessor = {"bufferView": len(accessors), "count": len(values)}
        accessor |= {"componentType": kinds[values.dtype.str[1:]], "type": types[values.shape[1]]}
        accessors.append(accessor | entries)
        data += values.tobytes()
    primitives = [primitive or {"attributes": {"POSITION": 0}}]
    address = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    contents = {"asset": {"version": "2.0"}, "meshes": [{"primitives": primitives}], "nodes": nodes}
    contents |= {"accessors": accessors, "bufferViews": views}
    return contents | {"buffers": [{"uri": address, "byteLength": len(data)}]} | more


def test_gltf_vertices_are_placed_by_their_nodes(tmp_path):
    rng = np.random.default_rng(0)
    points = rng.normal(size=(9, 3)).astype("<f4")
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    colors = rng.integers(0, 256, (9, 4)).astype("<u2")
    primitive = {"attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2}}
    # A quarter turn about z, then stretched along x and moved, within a moved parent.
    turn = {"rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)], "mesh": 0}
    nodes = [
        {"children": [1], "translation": [10, 0, 0]},
        {"children": [2], "matrix": [3, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 5, 0, 1]},
        turn,
    ]
    contents = gltf([(points, {}), (normals, {}), (colors, {"normalized": True})], nodes, primitive)
    file = point_files.read_points(write(tmp_path, "a.gltf", json.dumps(contents)))
    x, y, z = points.astype(float).T
    assert np.allclose(file.points, np.stack([10 - 3 * y, 5 + x, z], axis=1))
    nx, ny, nz = normals.astype(float).T
    expected = np.stack([-ny / 3, nx, nz], axis=1)
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert np.allclose(file.normals, expected)
    assert np.array_equal(file.attributes["colors"], colors[:, :3])


def test_gltf_with_a_buffer_beside_it(tmp_path):
    points = np.arange(27, dtype="<f4").reshape(9, 3)
    contents = gltf([(points, {})], [{"mesh": 0}])
    contents["buffers"] = [{"uri": "far%20away.bin", "byteLength": points.nbytes}]
    path = write(tmp_path, "a.gltf", json.dumps(contents))
    with pytest.raises(FileNotFoundError, match="far away"):
        point_files.read_points(path)
    (tmp_path / "far away.bin").write_bytes(points.tobytes())
    assert np.array_equal(point_files.read_points(path).points, points)
    for uri in ("http://example.org/a.bin", "../a.bin", "/etc/passwd", "file:///etc/passwd"):
        contents["buffers"] = [{"uri": uri, "byteLength": points.nbytes}]
        with pytest.raises(ValueError, match=r"a\.gltf: .* beside the file"):
            point_files.read_points(write(tmp_path, "a.gltf", json.dumps(contents)))


def test_gltf_strips_and_fans(tmp_path):
    points = np.arange(15, dtype="<f4").reshape(5, 3)
    for mode, expected in (
        (5, [[0, 1, 2], [3, 2, 1], [2, 3, 4]]),
        (6, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]),
        (0, []),
    ):
        primitive = {"attributes": {"POSITION": 0}, "mode": mode}
        contents = gltf([(points, {})], [{"mesh": 0}], primitive)
        _, triangles = reading.read_triangles(write(tmp_path, "a.gltf", json.dumps(contents)))
        assert triangles.tolist() == expected


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c["accessors"][0].update(count=10),
        lambda c: c["accessors"][0].update(count=2**62),
        lambda c: c["accessors"][0].update(count=-1),
        lambda c: c["accessors"][0].update(byteOffset=1),
        lambda c: c["bufferViews"][0].update(byteStride=0),
        lambda c: c["bufferViews"][0].update(byteLength=2**40),
        lambda c: (
            c["nodes"].append({"children": [0, 1], "mesh": 0}) or c["nodes"][0].update(children=[1])
        ),
        lambda c: c["nodes"][0].update(matrix=["a"] * 16),
        lambda c: c["nodes"][0].update(rotation=[10**400, 0, 0, 1]),
        lambda c: c.update(meshes=3),
        lambda c: c.update(asset={"version": "1.0"}),
        lambda c: c["meshes"][0]["primitives"][0].update(
            extensions={"KHR_draco_mesh_compression": 1}
        ),
    ],
)
def test_gltf_that_is_wrong_is_refused(tmp_path, change):
    contents = gltf([(np.zeros((9, 3), "<f4"), {})], [{"mesh": 0}], scenes=[{"nodes": [0]}])
    change(contents)
    with pytest.raises(ValueError, match=r"a\.gltf: not readable as glTF: \S"):
        point_files.read_points(write(tmp_path, "a.gltf", json.dumps(contents)))


def test_gltf_with_a_mesh_in_very_many_places(tmp_path):
    points = np.zeros((1000, 3), "<f4")
    contents = gltf([(points, {})], [{"mesh": 0}] * 20_000)
    with pytest.raises(ValueError, match="bytes of points out of"):
        point_files.read_points(write(tmp_path, "a.gltf", json.dumps(contents)))


def test_stl_with_another_number_of_facets_than_it_says(tmp_path):
    facets = np.zeros(7 * 50, np.uint8).tobytes()
    for count in (6, 8, 2**32 - 1):
        (tmp_path / "a.stl").write_bytes(b"\0" * 80 + struct.pack("<I", count) + facets)
        with pytest.raises(ValueError, match=f"says {count} facets, it has room for 7"):
            point_files.read_points(tmp_path / "a.stl")
