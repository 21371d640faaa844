"""Scans that say where their scanner stood: PTX, E57; LAS with its coordinate system."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from o3d_sofnn.files import las, point_files

RNG = np.random.default_rng(0)
POINTS = RNG.uniform(-5.0, 5.0, (24, 3)).round(3)
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
PLACE = np.array([100.0, 200.0, 3.0])


def ptx(points, place=PLACE, turn=TURN, position=None, size=(6, 4), colors=None):
    """Return a scan: points in the scanner's frame, its pose as a matrix with the place below."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = turn.T, place
    lines = [
        *map(str, size),
        *(" ".join(map(str, row)) for row in [PLACE if position is None else position]),
    ]
    lines += ["1 0 0", "0 1 0", "0 0 1", *(" ".join(map(str, row)) for row in matrix.tolist())]
    for i, point in enumerate(points.tolist()):
        behind = [0.5] if colors is None else [0.5, *colors[i]]
        lines.append(" ".join(map(repr, [*point, *behind])))
    return "\n".join(lines) + "\n"


def test_ptx_in_common_coordinates_with_the_place_of_the_scanner(tmp_path):
    (tmp_path / "a.ptx").write_text(ptx(POINTS))
    file = point_files.read_points(tmp_path / "a.ptx")
    assert np.allclose(file.points, POINTS @ TURN.T + PLACE)
    assert np.array_equal(file.viewpoint, PLACE)
    assert file.shape == (6, 4)
    assert np.array_equal(file.attributes["intensity"], np.full((24, 1), 0.5))
    # The pose may be in the first line alone.
    (tmp_path / "b.ptx").write_text(ptx(POINTS, place=np.zeros(3), turn=np.eye(3)))
    file = point_files.read_points(tmp_path / "b.ptx")
    assert np.array_equal(file.points, POINTS)
    assert np.array_equal(file.viewpoint, PLACE)


def test_ptx_with_several_scans_and_places_without_points(tmp_path):
    holes = POINTS.copy()
    holes[[3, 7]] = 0.0
    colors = RNG.integers(0, 256, (24, 3)).tolist()
    other = np.array([7.0, 8.0, 9.0])
    (tmp_path / "a.ptx").write_text(
        ptx(holes, colors=colors) + ptx(POINTS, place=other, colors=colors)
    )
    file = point_files.read_points(tmp_path / "a.ptx")
    assert len(file.points) == 22 + 24
    assert np.allclose(file.points[22:], POINTS @ TURN.T + other)
    assert np.array_equal(file.viewpoint, np.repeat([PLACE, other], [22, 24], axis=0))
    assert np.array_equal(file.attributes["colors"][22:], colors)
    assert file.shape is None
    assert file.notes == ("scan 1: 2 of 24 places hold no point",)


@pytest.mark.parametrize("size", [(6, 5), (10**8, 10**8), (6, 3)])
def test_ptx_with_more_or_fewer_points_than_it_says(tmp_path, size):
    (tmp_path / "a.ptx").write_text(ptx(POINTS, size=size))
    with pytest.raises(ValueError, match=r"a\.ptx: line \d+: expected"):
        point_files.read_points(tmp_path / "a.ptx")


def e57(path, scans):
    pye57 = pytest.importorskip("pye57")
    file = pye57.E57(str(path), mode="w")
    for columns, rotation, translation in scans:
        file.write_scan_raw(columns, rotation=rotation, translation=translation)
    file.close()


def columns(points, **more):
    return {f"cartesian{axis}": points[:, i] for i, axis in enumerate("XYZ")} | more


def test_e57_in_common_coordinates_with_the_places_of_the_scanners(tmp_path):
    quarter = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    levels = RNG.integers(0, 256, (24, 3)).astype(np.uint8)
    colors = {f"color{name}": levels[:, i] for i, name in enumerate(("Red", "Green", "Blue"))}
    state = np.zeros(24, np.int8)
    state[5] = 2
    first = columns(POINTS, **colors, cartesianInvalidState=state)
    second = columns(POINTS, **colors, intensity=np.linspace(0, 1, 24).astype("f4"))
    e57(tmp_path / "a.e57", [(first, quarter, PLACE), (second, np.array([1.0, 0, 0, 0]), -PLACE)])
    file = point_files.read_points(tmp_path / "a.e57")
    expected = np.vstack([np.delete(POINTS @ TURN.T + PLACE, 5, axis=0), POINTS - PLACE])
    assert np.allclose(file.points, expected, atol=1e-5)
    assert np.array_equal(file.viewpoint, np.repeat([PLACE, -PLACE], [23, 24], axis=0))
    assert np.array_equal(
        file.attributes["colors"], np.vstack([np.delete(levels, 5, axis=0), levels])
    )
    assert file.attributes["colors"].dtype == np.uint8
    assert file.notes == (
        "scan 1: 1 of 24 places hold no point",
        "left out, as not all scans have them: intensity",
    )


def test_e57_at_the_origin_has_no_place(tmp_path):
    unturned = np.array([1.0, 0.0, 0.0, 0.0])
    e57(tmp_path / "a.e57", [(columns(POINTS), unturned, np.zeros(3))])
    assert point_files.read_points(tmp_path / "a.e57").viewpoint is None


def test_a_damaged_e57_is_one_line(tmp_path, capfd):
    e57(tmp_path / "a.e57", [(columns(POINTS), np.array([1.0, 0, 0, 0]), PLACE)])
    whole = (tmp_path / "a.e57").read_bytes()
    for data in (whole[:-1], whole[:3000] + b"\0" + whole[3001:]):
        (tmp_path / "b.e57").write_bytes(data)
        with pytest.raises(ValueError, match=r"b\.e57: not readable: \S") as caught:
            point_files.read_points(tmp_path / "b.e57")
        assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def las_file(path, version="1.4", kind=7, vlrs=(), evlrs=()):
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(version=version, point_format=kind)
    header.scales = [0.001] * 3
    header.vlrs.extend(laspy.VLR(*vlr) for vlr in vlrs)
    header.add_extra_dims([laspy.ExtraBytesParams("axis", "3f4")])
    data = laspy.LasData(header)
    data.x, data.y, data.z = POINTS.T
    data.axis = POINTS.astype("f4")
    if evlrs:
        data.evlrs = laspy.vlrs.vlrlist.VLRList(laspy.VLR(*vlr) for vlr in evlrs)
    with path.open("wb") as stream:
        data.write(stream, do_compress=path.suffix == ".laz")
    return path


@pytest.mark.parametrize("ending", [".las", ".laz"])
def test_coordinate_systems_of_las(tmp_path, ending):
    keys = struct.pack("<12H", 1, 1, 0, 2, 2048, 0, 1, 4258, 3072, 0, 1, 25832)
    path = las_file(tmp_path / f"a{ending}", vlrs=[("LASF_Projection", 34735, "", keys)])
    assert point_files.read_points(path).crs == "EPSG:25832"
    text = b'PROJCS["a"]\0'
    path = las_file(tmp_path / f"b{ending}", evlrs=[("LASF_Projection", 2112, "", text)])
    file = point_files.read_points(path)
    assert file.crs == 'PROJCS["a"]'
    assert np.allclose(file.points, POINTS, atol=1e-9)
    assert np.array_equal(file.attributes["axis"], POINTS.astype("f4"))


@pytest.mark.parametrize("out", [".las", ".laz"])
@pytest.mark.parametrize("ending", [".las", ".laz"])
@pytest.mark.parametrize(
    ("version", "kind"), [("1.1", 0), ("1.2", 3), ("1.3", 5), ("1.4", 6), ("1.4", 10)]
)
def test_every_format_of_las_can_be_written_again(tmp_path, version, kind, ending, out):
    laspy = pytest.importorskip("laspy")
    records = [("mine", 7, "a record", b"contents"), ("copc", 1, "", bytes(160))]
    extended = (
        [("copc", 1000, "", bytes(32)), ("mine", 8, "long", bytes(70_000))]
        if version == "1.4"
        else []
    )
    path = las_file(tmp_path / f"a{ending}", version, kind, records, extended)
    # Letters of another alphabet in the header, as scanners write them.
    data = bytearray(path.read_bytes())
    data[26:31] = b"\xfcber\0"
    path.write_bytes(data)
    file = point_files.read_points(path)
    point_files.check_contents(tmp_path / f"b{out}", file, template=path)
    with (tmp_path / f"b{out}").open("w+b") as stream:
        cloud = point_files.as_cloud(file)
        las.write_las(stream, type(cloud)(cloud.points, POINTS), out == ".laz", path)
    back = laspy.read(tmp_path / f"b{out}")
    assert back.header.point_format.id == kind
    assert str(back.header.version) == version
    assert [record.record_data for record in back.vlrs if record.user_id == "mine"] == [b"contents"]
    assert not any(record.user_id == "copc" for record in [*back.vlrs, *(back.evlrs or [])])
    assert [len(record.record_data) for record in back.evlrs or []] == (
        [70_000] if extended else []
    )
    assert np.array_equal(back.axis, POINTS.astype("f4"))
    assert np.array_equal(back.NormalY, POINTS[:, 1])
    assert np.array_equal(back.points.array["X"], laspy.read(path).points.array["X"])


def test_las_of_the_first_version(tmp_path):
    laspy = pytest.importorskip("laspy")
    path = las_file(tmp_path / "a.las", "1.2", 1)
    data = bytearray(path.read_bytes())
    data[25] = 0
    path.write_bytes(data)
    file = point_files.read_points(path)
    with (tmp_path / "b.las").open("w+b") as stream:
        las.write_las(stream, point_files.as_cloud(file), False, path)
    assert np.allclose(laspy.read(tmp_path / "b.las").x, POINTS[:, 0])


def test_normals_that_were_whole_numbers_are_replaced(tmp_path):
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.add_extra_dims([laspy.ExtraBytesParams(f"Normal{axis}", "i1") for axis in "XYZ"])
    data = laspy.LasData(header)
    data.x, data.y, data.z = POINTS.T
    data.write(str(tmp_path / "a.las"))
    cloud = point_files.as_cloud(point_files.read_points(tmp_path / "a.las"))
    with (tmp_path / "b.las").open("w+b") as stream:
        las.write_las(stream, type(cloud)(cloud.points, POINTS / 9), False, tmp_path / "a.las")
    assert np.array_equal(laspy.read(tmp_path / "b.las").NormalX, POINTS[:, 0] / 9)
