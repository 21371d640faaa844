"""Files of a run: read in parts, overlapping, georeferenced; the call and the command."""

from __future__ import annotations

import json

import laspy
import numpy as np
import pytest
from mesh_checks import assert_valid_mesh
from shapes import sphere

from o3d_sofnn import reconstruct_tiles
from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.cli.main import main
from o3d_sofnn.files import point_files
from o3d_sofnn.files.readers.ply import read_ply_mesh
from o3d_sofnn.tiles.work import chunks

OFFSET = np.array([500_000.0, 4_100_000.0, 200.0])


POINTS = sphere(2500).points * np.array([7.6, 7.6, 3.0]) + OFFSET


def las_file(path, points):
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.offsets, header.scales = np.floor(points.min(axis=0)), [1e-4] * 3
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    data.write(path)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Three files that overlap: LAS, LAZ and binary PLY."""
    folder = tmp_path_factory.mktemp("inputs")
    las_file(folder / "a.las", POINTS[:1200])
    las_file(folder / "b.laz", POINTS[1000:2000])
    rounded = np.asarray(laspy.read(folder / "b.laz").xyz)
    rest = np.concatenate([rounded[-100:], POINTS[2000:]])
    point_files.write_point_cloud(folder / "c.ply", CloudArrays(rest))
    return folder


def test_parts_are_the_points_of_the_files(folder, monkeypatch):
    monkeypatch.setattr(chunks, "CHUNK", 300)
    files = chunks.Files(chunks.found([folder / "*.la[sz]", folder / "c.ply"]))
    parts = list(files.chunks())
    assert max(map(len, parts)) <= 1000
    expected = [point_files.read_points(path).points for path in files.paths]
    np.testing.assert_array_equal(np.concatenate(parts), np.concatenate(expected))


def test_no_part_of_a_large_file_is_read_twice_or_whole(folder, monkeypatch):
    monkeypatch.setattr(chunks, "CHUNK", 100)

    def never(path):
        raise AssertionError(f"{path} was read whole")

    monkeypatch.setattr(point_files, "read_points", never)
    assert sum(map(len, chunks.Files(chunks.found([folder])).chunks())) == 1200 + 1000 + 600


@pytest.mark.parametrize("name", ["a.las", "b.laz", "c.ply"])
def test_a_damaged_file_is_named(folder, tmp_path, name):
    raw = (folder / name).read_bytes()
    broken = tmp_path / name
    broken.write_bytes(raw[: int(0.7 * len(raw))])
    with pytest.raises(ValueError, match=name):
        reconstruct_tiles([folder / "a.las", broken], tmp_path / "out", points_per_tile=1000)


def test_what_is_no_input_is_said(tmp_path):
    with pytest.raises(ValueError, match="got none"):
        chunks.found([tmp_path / "*.las"])
    (tmp_path / "a.txt").write_text("1 2 3\n")
    with pytest.raises(ValueError, match=r"a\.txt: expected one of the endings"):
        chunks.found([tmp_path / "a.txt"])


def test_bad_options_are_said(folder, tmp_path):
    for options, text in (
        ({"points_per_tile": 10}, "points_per_tile"),
        ({"workers": 0}, "workers"),
        ({"workers": 1, "scheduler": "tcp://x:1"}, "scheduler"),
        ({"format": "stl"}, "format"),
        ({"trim": 2.0}, "trim"),
    ):
        with pytest.raises(ValueError, match=text):
            reconstruct_tiles(folder, tmp_path / "out", **options)


def test_a_machine_that_is_too_small_says_so(folder, tmp_path, monkeypatch):
    monkeypatch.setattr("o3d_sofnn.tiles.work.memory.available", lambda: 1e6)
    with pytest.raises(MemoryError, match=r"tile \d+ of \d+ points .* points_per_tile"):
        reconstruct_tiles(folder, tmp_path / "out", points_per_tile=1000)


def test_the_command_writes_mesh_tiles_normals_and_report(folder, tmp_path, capsys):
    out = tmp_path / "out"
    options = ["--points-per-tile", "1000", "--normals", "--format", "ply", "--threads", "1"]
    assert main(["tiles", str(folder), "--out", str(out), "--progress", "plain", *options]) == 0
    assert "PROGRESS" in capsys.readouterr().out
    vertices, triangles = read_ply_mesh(out / "mesh.ply")
    assert_valid_mesh(vertices - OFFSET, triangles.astype(np.int32), components=1)
    report = json.loads((out / "report.json").read_text())
    assert report["watertight"]
    assert report["points"] == 2800
    assert report["triangles"] == len(triangles)
    parts = [read_ply_mesh(path) for path in sorted((out / "tiles").glob("*.ply"))]
    assert len(parts) == report["meshes"] > 1
    assert sum(len(part[1]) for part in parts) == len(triangles)
    together = np.concatenate([part[0] for part in parts])
    np.testing.assert_array_equal(np.unique(together, axis=0), np.unique(vertices, axis=0))
    clouds = [laspy.read(path) for path in sorted((out / "normals").glob("*.laz"))]
    assert sum(len(cloud.points) for cloud in clouds) == 2800
    for cloud in clouds:
        normals = np.stack([cloud["NormalX"], cloud["NormalY"], cloud["NormalZ"]], axis=1)
        outward = np.asarray(cloud.xyz) - OFFSET
        assert ((normals * outward).sum(axis=1) > 0.0).mean() > 0.99


def test_the_command_names_what_is_missing(tmp_path, capsys):
    assert main(["tiles", str(tmp_path / "no.las"), "--out", str(tmp_path / "out")]) == 2
    assert "no.las" in capsys.readouterr().err
