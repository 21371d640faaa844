"""GLB outputs, read back by this package, by trimesh and by the format's rules."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import shapes

from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.cli import main
from o3d_sofnn.files import point_files, reading

RNG = np.random.default_rng(5)
VERTICES = RNG.normal(size=(50, 3)).astype(np.float32).astype(np.float64)
NORMALS = VERTICES / np.linalg.norm(VERTICES, axis=1, keepdims=True)
TRIANGLES = np.array([RNG.permutation(50)[:3] for _ in range(80)])
COLORS = RNG.integers(0, 256, (50, 3)).astype(np.uint8)


def parts(path: Path) -> tuple[dict, bytes]:
    """Return the JSON and the binary part of a file whose sizes are as the format asks."""
    data = path.read_bytes()
    magic, version, total, length, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, total, kind) == (b"glTF", 2, len(data), b"JSON")
    contents = json.loads(data[20 : 20 + length])
    binary = data[20 + length :]
    assert length % 4 == 0
    if binary:
        assert struct.unpack_from("<I4s", binary) == (len(binary) - 8, b"BIN\0")
    return contents, binary[8:]


def test_it_comes_back_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "mesh.glb"
    vertices = CloudArrays(VERTICES, NORMALS, {"colors": COLORS})
    point_files.write_triangle_mesh(path, (vertices, TRIANGLES))
    file = point_files.read_points(path)
    assert np.array_equal(file.points, VERTICES)
    assert np.allclose(file.normals, NORMALS, atol=1e-7)
    assert np.array_equal(file.attributes["colors"], COLORS)
    assert file.notes == ()
    points, triangles = reading.read_triangles(path)
    assert np.array_equal(points[triangles], VERTICES[TRIANGLES])


def test_trimesh_reads_it(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / "mesh.glb"
    place = np.array([5e5, 4.9e6, 100.0])
    vertices = CloudArrays(VERTICES + place, NORMALS, {"colors": COLORS})
    point_files.write_triangle_mesh(path, (vertices, TRIANGLES))
    mesh = trimesh.load(path, process=False).to_mesh()
    assert np.abs(mesh.vertices - VERTICES - place).max() < 1e-6
    assert np.array_equal(mesh.faces, TRIANGLES)
    assert np.array_equal(mesh.visual.vertex_colors[:, :3], COLORS)


def test_the_parts_are_as_the_format_asks(tmp_path: Path) -> None:
    path = tmp_path / "mesh.glb"
    vertices = CloudArrays(VERTICES, NORMALS, {"colors": COLORS})
    point_files.write_triangle_mesh(path, (vertices, TRIANGLES))
    contents, binary = parts(path)
    assert contents["buffers"] == [{"byteLength": len(binary)}]
    end = 0
    for view in contents["bufferViews"]:
        assert view["byteOffset"] == end
        assert end % 4 == 0
        end += view["byteLength"]
    assert end == len(binary)
    position = contents["accessors"][0]
    stored = np.frombuffer(binary, "<f4", 150).reshape(50, 3)
    assert position["min"] == stored.min(axis=0).tolist()
    assert position["max"] == stored.max(axis=0).tolist()
    assert "translation" not in contents["nodes"][0]


def test_vertices_without_triangles_are_points(tmp_path: Path) -> None:
    path = tmp_path / "mesh.glb"
    nothing = np.zeros((0, 3), dtype=np.int64)
    point_files.write_triangle_mesh(path, (CloudArrays(VERTICES), nothing))
    assert parts(path)[0]["meshes"][0]["primitives"][0]["mode"] == 0
    assert np.array_equal(point_files.read_points(path).points, VERTICES)


def test_a_mesh_of_nothing_is_a_scene_of_nothing(tmp_path: Path) -> None:
    nothing = np.zeros((0, 3), dtype=np.int64)
    path = tmp_path / "mesh.glb"
    point_files.write_triangle_mesh(path, (CloudArrays(np.zeros((0, 3))), nothing))
    assert parts(path) == ({"asset": {"version": "2.0", "generator": "o3d_sofnn"}}, b"")
    assert len(point_files.read_points(path).points) == 0


def test_vertices_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    vertices = VERTICES.copy()
    vertices[3, 1] = np.nan
    with pytest.raises(ValueError, match="expected finite vertices"):
        point_files.write_triangle_mesh(tmp_path / "a.glb", (CloudArrays(vertices), TRIANGLES))
    assert list(tmp_path.iterdir()) == []


def test_what_it_has_no_room_for_is_said(tmp_path: Path, capfd) -> None:
    np.savetxt(tmp_path / "scan.xyz", shapes.torus(600).points)
    command = ["reconstruct", str(tmp_path / "scan.xyz"), str(tmp_path / "mesh.glb")]
    assert main.main([*command, "--attributes"]) == 0
    assert "mesh.glb: not kept: confidence noise; .ply keeps them" in capfd.readouterr().err
