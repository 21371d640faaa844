"""``--attributes``: what is known of each point, read back by other libraries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import shapes

import o3d_sofnn
from o3d_sofnn.cli import main
from o3d_sofnn.files import point_files

SHAPE = shapes.torus(1500)


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    points = SHAPE.points.copy()
    points[7] = np.nan
    np.savetxt(tmp_path / "scan.xyz", points, fmt="%.17g")
    return tmp_path / "scan.xyz"


def test_ply_has_named_properties(tmp_path: Path, scan: Path) -> None:
    plyfile = pytest.importorskip("plyfile")
    assert main.main(["normals", str(scan), str(tmp_path / "out.ply"), "--attributes"]) == 0
    vertices = plyfile.PlyData.read(tmp_path / "out.ply")["vertex"]
    _, details = o3d_sofnn.estimate_normals(np.loadtxt(scan), return_details=True)
    assert np.array_equal(vertices["confidence"], details.confidence)
    assert np.array_equal(vertices["noise"], details.noise, equal_nan=True)
    assert np.array_equal(vertices["outlier"], details.outliers)
    assert vertices["outlier"].dtype == np.uint8
    assert vertices["outlier"][7] == 1


def test_without_the_option_there_are_none(tmp_path: Path, scan: Path) -> None:
    assert main.main(["normals", str(scan), str(tmp_path / "out.ply")]) == 0
    assert not point_files.read_points(tmp_path / "out.ply").attributes


def test_a_mesh_has_them_per_vertex(tmp_path: Path, scan: Path) -> None:
    plyfile = pytest.importorskip("plyfile")
    assert main.main(["reconstruct", str(scan), str(tmp_path / "out.ply"), "--attributes"]) == 0
    vertices = plyfile.PlyData.read(tmp_path / "out.ply")["vertex"]
    *_, details = o3d_sofnn.reconstruct_surface(np.loadtxt(scan), return_details=True)
    assert np.array_equal(vertices["confidence"], details.confidence)
    noise = details.normals.noise
    assert (
        np.nanmin(noise) <= vertices["noise"].min() <= vertices["noise"].max() <= np.nanmax(noise)
    )


@pytest.mark.parametrize("ending", ["las", "laz"])
@pytest.mark.parametrize("template", [True, False])
def test_las_has_extra_bytes(tmp_path: Path, ending: str, template: bool) -> None:
    laspy = pytest.importorskip("laspy")
    scan = tmp_path / "scan.xyz"
    if template:
        scan = tmp_path / "scan.las"
        header = laspy.LasHeader(point_format=1, version="1.2")
        header.scales = [1e-4] * 3
        header.add_extra_dims([laspy.ExtraBytesParams("confidence", "u2")])
        data = laspy.LasData(header)
        data.x, data.y, data.z = SHAPE.points.T
        data["confidence"] = np.arange(1500)
        data.write(scan)
    else:
        np.savetxt(scan, SHAPE.points)
    output = tmp_path / f"out.{ending}"
    assert main.main(["normals", str(scan), str(output), "--attributes"]) == 0
    back = laspy.read(output)
    points = point_files.read_points(scan).points
    _, details = o3d_sofnn.estimate_normals(points, return_details=True)
    ours = "confidence_2" if template else "confidence"
    assert np.array_equal(back[ours], details.confidence)
    assert np.array_equal(back["noise"], details.noise)
    assert np.array_equal(back["outlier"], details.outliers)
    if template:
        assert np.array_equal(back["confidence"], np.arange(1500))


@pytest.mark.parametrize(
    ("command", "ending", "lost"),
    [
        *(("normals", ending, "confidence noise outlier") for ending in ("pcd", "xyz", "xyzn")),
        *(("reconstruct", ending, "confidence noise") for ending in ("obj", "off", "stl")),
    ],
)
def test_what_a_format_cannot_hold_is_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], command: str, ending: str, lost: str
) -> None:
    np.savetxt(tmp_path / "scan.xyz", SHAPE.points)
    output = tmp_path / f"out.{ending}"
    assert main.main([command, str(tmp_path / "scan.xyz"), str(output), "--attributes"]) == 0
    expected = f"o3d-sofnn: WARNING: {output}: not kept: {lost}; .ply keeps them\n"
    assert capfd.readouterr().err == expected


def test_a_name_that_is_taken_gets_a_number(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    np.savetxt(tmp_path / "scan.xyz", SHAPE.points)
    for one, two in (("scan.xyz", "one.ply"), ("one.ply", "two.ply")):
        command = ["normals", str(tmp_path / one), str(tmp_path / two), "--attributes"]
        assert main.main(command) == 0
    names = {"confidence", "noise", "outlier"}
    kept = names | {f"{name}_2" for name in names}
    assert set(point_files.read_points(tmp_path / "two.ply").attributes) == kept
    lines = capfd.readouterr().err.splitlines()
    assert lines[0].endswith("two.ply: has 'confidence' already, the new one is 'confidence_2'")
    assert len(lines) == 3
