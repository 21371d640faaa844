"""Coordinate systems and coordinates far from zero: what outputs keep of them."""

from __future__ import annotations

import json
import sys
import types
from pathlib import Path

import numpy as np
import pytest
import shapes

from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.cli import main
from o3d_sofnn.files import point_files, sidecar

laspy = pytest.importorskip("laspy")

WKT = 'PROJCS["made for a test",GEOGCS["WGS 84",DATUM["WGS_1984"]],UNIT["metre",1]]'
PLACE = np.array([509_000.0, 5_155_000.0, 300.0])
POINTS = np.round(shapes.sphere(600, radius=10.0).points + PLACE, 3)


def write_las(path: Path, wkt: str | None = WKT, version: str = "1.4", epsg: int = 0) -> Path:
    header = laspy.LasHeader(point_format=6 if version == "1.4" else 1, version=version)
    header.offsets, header.scales = PLACE, [0.001] * 3
    if wkt is not None:
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(wkt))
        header.global_encoding.wkt = True
    if epsg:
        keys = np.array([1, 1, 0, 1, 3072, 0, 1, epsg], dtype="<u2").tobytes()
        header.vlrs.append(laspy.VLR("LASF_Projection", 34735, "", keys))
    data = laspy.LasData(header)
    data.x, data.y, data.z = POINTS.T
    data.write(path)
    return path


@pytest.fixture
def scan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return write_las(Path("scan.las"))


def lines(capfd: pytest.CaptureFixture[str]) -> list[str]:
    return capfd.readouterr().err.splitlines()


@pytest.mark.parametrize("ending", ["ply", "pcd", "xyz", "npz"])
def test_the_system_of_las_is_kept_beside_other_formats(scan: Path, ending: str) -> None:
    assert main.main(["normals", str(scan), f"out.{ending}"]) == 0
    assert Path("out.prj").read_text() == WKT
    assert point_files.read_points(f"out.{ending}").crs == WKT
    # Once more, from the file beside.
    assert main.main(["reconstruct", f"out.{ending}", "mesh.glb"]) == 0
    assert Path("mesh.prj").read_text() == WKT


@pytest.mark.parametrize("ending", ["las", "laz"])
def test_las_keeps_it_inside(scan: Path, ending: str) -> None:
    assert main.main(["normals", str(scan), f"out.{ending}"]) == 0
    assert point_files.read_points(f"out.{ending}").crs == WKT
    assert main.main(["normals", str(scan), "out.ply"]) == 0
    assert main.main(["normals", "out.ply", f"again.{ending}"]) == 0
    assert point_files.read_points(f"again.{ending}").crs == WKT
    assert laspy.open(f"again.{ending}").header.global_encoding.wkt
    assert not Path("again.prj").exists()


def test_las_of_any_ending_is_kept_whole(scan: Path, capfd) -> None:
    scan.rename("scan.dat")
    assert main.main(["normals", "scan.dat", "out.las", "--input-format", "las"]) == 0
    assert lines(capfd) == []
    assert point_files.read_points("out.las").crs == WKT


def test_an_old_las_has_no_place_for_text(tmp_path: Path, monkeypatch, capfd) -> None:
    monkeypatch.chdir(tmp_path)
    write_las(Path("old.las"), wkt=None, version="1.2")
    Path("old.prj").write_text(WKT)
    assert main.main(["normals", "old.las", "out.las"]) == 0
    said = "not kept: the coordinate system; LAS has text for it since version 1.4"
    assert lines(capfd) == [f"o3d-sofnn: WARNING: {said}"]


def test_a_number_needs_pyproj(tmp_path: Path, monkeypatch, capfd) -> None:
    monkeypatch.chdir(tmp_path)
    write_las(Path("scan.las"), wkt=None, version="1.2", epsg=25832)
    monkeypatch.setitem(sys.modules, "pyproj", None)
    assert main.main(["normals", "scan.las", "out.ply"]) == 0
    said = "not kept: coordinate system EPSG:25832; for its text type: pip install pyproj"
    assert lines(capfd) == [f"o3d-sofnn: WARNING: out.ply: {said}"]
    assert not Path("out.prj").exists()
    cloud = CloudArrays(POINTS, np.zeros_like(POINTS))
    point_files.write_point_cloud("new.las", cloud, crs="EPSG:25832")
    assert point_files.read_points("new.las").crs is None

    class Known:
        def to_wkt(self, version: str) -> str:
            return WKT

    def unknown(crs: str) -> None:
        raise RuntimeError("Invalid projection")

    for found in (unknown, lambda crs: Known()):
        made = types.SimpleNamespace(CRS=types.SimpleNamespace(from_user_input=found))
        monkeypatch.setitem(sys.modules, "pyproj", made)
        assert not Path("out.prj").exists()
        assert main.main(["normals", "scan.las", "out.ply"]) == 0
    assert lines(capfd)[-1].endswith("coordinate system EPSG:25832; pyproj does not know it")
    assert Path("out.prj").read_text() == WKT


def test_another_system_beside_the_output_is_not_overwritten(scan: Path, capfd) -> None:
    Path("out.prj").write_text(WKT.replace("test", "map"))
    assert main.main(["normals", str(scan), "out.ply"]) == main.BAD_INPUT
    said = "out.prj: expected the coordinate system of the points, got another"
    assert lines(capfd) == [f"o3d-sofnn: error: {said}"]
    assert sorted(path.name for path in Path().iterdir()) == ["out.prj", "scan.las"]
    Path("out.prj").write_text(f"\ufeff{WKT}\n")
    assert main.main(["normals", str(scan), "out.ply"]) == 0


def test_a_report_is_not_overwritten_by_the_system(scan: Path, capfd) -> None:
    command = ["normals", str(scan), "out.ply", "--json", "out.prj"]
    assert main.main(command) == main.BAD_INPUT
    assert "out.prj: expected another file than out.prj" in lines(capfd)[0]


def test_a_system_that_is_left_over_is_said(scan: Path, capfd) -> None:
    np.savetxt("plain.xyz", POINTS, fmt="%.3f")
    Path("out.prj").write_text(WKT)
    assert main.main(["normals", "plain.xyz", "out.ply"]) == 0
    assert "out.prj: is there, but the points have no coordinate system" in lines(capfd)[0]


@pytest.mark.parametrize("text", [b"", b"\xff\xfe\x00", b"project of something", b"0" * 100_000])
def test_other_files_with_that_ending_are_no_system(tmp_path: Path, text: bytes) -> None:
    np.savetxt(tmp_path / "scan.xyz", POINTS)
    (tmp_path / "scan.prj").write_bytes(text)
    file = point_files.read_points(tmp_path / "scan.xyz")
    assert file.crs is None
    assert file.notes == ("scan.prj left out: no coordinate system as WKT",)


@pytest.mark.parametrize(
    "text", ['GEOGCS["a"]', 'PROJCRS["a"]', 'COMPD_CS["a"]', "BOUNDCRS[a]", 'LOCAL_CS["a"]']
)
def test_all_kinds_of_systems_are_known(tmp_path: Path, text: str) -> None:
    (tmp_path / "scan.prj").write_text(text)
    assert sidecar.read(tmp_path / "scan.ply") == (text, ())


def test_the_standard_output_has_no_place_for_it(scan: Path, capfdbinary) -> None:
    assert main.main(["normals", str(scan), "-", "--output-format", "ply"]) == 0
    said = b"o3d-sofnn: WARNING: standard output: not kept: the coordinate system"
    assert capfdbinary.readouterr().err.startswith(said)


def test_glb_loses_nothing_far_from_zero(scan: Path, capfd) -> None:
    for name in ("mesh.ply", "mesh.glb"):
        assert main.main(["reconstruct", str(scan), name]) == 0
    assert not [line for line in lines(capfd) if "precision" in line]
    exact, stored = (point_files.read_points(name).points for name in ("mesh.ply", "mesh.glb"))
    assert np.abs(exact - stored).max() < 2e-6
    assert main.main(["reconstruct", str(scan), "mesh.stl"]) == 0
    assert "single precision rounds these coordinates to 0.5" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("command", "ending"),
    [("normals", "pcd"), ("normals", "ply"), ("reconstruct", "stl"), ("reconstruct", "obj")],
)
@pytest.mark.parametrize("given", ["auto", "509000,5155000,300", "-1,-2.5,1e3"])
def test_an_offset_is_taken_and_said(scan: Path, capfd, command, ending, given) -> None:
    assert main.main([command, str(scan), "far.ply"]) == 0
    options = ["--offset", given, "--json", "report.json"]
    assert main.main([command, str(scan), f"out.{ending}", *options]) == 0
    offset = json.loads(Path("report.json").read_text())["offset"]
    if given == "auto":
        assert offset == [508990.0, 5154990.0, 290.0]
    else:
        assert offset == [float(each) for each in given.split(",")]
    shown = " ".join(f"{each:.15g}" for each in offset)
    said = [line for line in lines(capfd) if "less" in line]
    assert said == [
        f"o3d-sofnn: WARNING: out.{ending}: coordinates are those of IN less {shown}; their "
        "coordinate system is not kept"
    ]
    assert not Path("out.prj").exists()
    near = point_files.read_points(f"out.{ending}").points + offset
    far = point_files.read_points("far.ply").points
    if ending != "stl":  # which has vertices for every facet
        assert np.abs(near - far).max() < (0.5 if given.startswith("-") else 1e-5)
    assert np.abs(near.min(axis=0) - far.min(axis=0)).max() < 0.5


def test_las_takes_no_offset(scan: Path, capfd) -> None:
    assert main.main(["normals", str(scan), "out.laz", "--offset", "auto"]) == main.BAD_INPUT
    assert lines(capfd)[0].startswith("o3d-sofnn: error: --offset: expected another OUT than LAS")


@pytest.mark.parametrize("text", ["1,2", "near", "1,2,nan", "1,2,3,4", ""])
def test_a_wrong_offset_is_one_line(scan: Path, capfd, text: str) -> None:
    with pytest.raises(SystemExit) as caught:
        main.main(["normals", str(scan), "out.ply", "--offset", text])
    assert caught.value.code == main.BAD_INPUT
    assert len(lines(capfd)) == 1


def test_python_writes_the_system_too(tmp_path: Path) -> None:
    cloud = CloudArrays(POINTS, np.zeros_like(POINTS))
    for ending in ("ply", "laz"):
        point_files.write_point_cloud(tmp_path / f"a.{ending}", cloud, crs=WKT)
        assert point_files.read_points(tmp_path / f"a.{ending}").crs == WKT
    point_files.write_triangle_mesh(tmp_path / "b.obj", (cloud, [[0, 1, 2]]), crs=WKT)
    assert point_files.read_points(tmp_path / "b.obj").crs == WKT
