"""LAS and LAZ: every format is read and written again with all that it holds."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from o3d_sofnn import adapters
from o3d_sofnn.files import las, point_files

UTM = np.array([5e5, 4.9e6, 100.0])
POINTS = np.random.default_rng(0).uniform(-5.0, 5.0, (24, 3)).round(3)


def utm_file(path, points, **dimensions):
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(point_format=2, version="1.2")
    header.offsets, header.scales = UTM, [0.001] * 3
    data = laspy.LasData(header)
    data.x, data.y, data.z = points.T
    for name, values in dimensions.items():
        setattr(data, name, values)
    data.write(path)


@pytest.mark.parametrize("ending", [".las", ".laz"])
def test_las_to_las_keeps_everything_in_double(tmp_path, ending):
    laspy = pytest.importorskip("laspy")
    rng = np.random.default_rng(0)
    points = UTM + np.round(rng.uniform(0.0, 30.0, (100, 3)), 3)
    source = tmp_path / f"in{ending}"
    utm_file(source, points, red=np.arange(100) * 600, classification=np.arange(100) % 20)
    cloud = point_files.read_point_cloud(source)
    assert np.abs(cloud.point.positions.numpy() - points).max() < 1e-8
    assert np.array_equal(cloud.point.colors.numpy()[:, 0], np.arange(100) * 600)
    normals = rng.normal(size=points.shape)
    adapters.write_normals(cloud, normals)
    point_files.write_point_cloud(tmp_path / f"out{ending}", cloud, template=source)

    before, after = laspy.read(source), laspy.read(tmp_path / f"out{ending}")
    for name in before.point_format.dimension_names:
        assert np.array_equal(np.asarray(before[name]), np.asarray(after[name])), name
    assert np.array_equal(before.header.scales, after.header.scales)
    back = point_files.read_point_cloud(tmp_path / f"out{ending}")
    assert np.array_equal(back.point.positions.numpy(), cloud.point.positions.numpy())
    assert np.array_equal(back.point.normals.numpy(), normals)
    assert np.array_equal(back.point.colors.numpy(), cloud.point.colors.numpy())
    # A second run replaces the normals instead of adding more dimensions.
    adapters.write_normals(back, -normals)
    point_files.write_point_cloud(
        tmp_path / f"out{ending}", back, template=tmp_path / f"out{ending}"
    )
    again = point_files.read_point_cloud(tmp_path / f"out{ending}")
    assert np.array_equal(again.point.normals.numpy(), -normals)


@pytest.mark.parametrize("keep", [0, 100, 300, 900])
def test_a_las_cut_short_is_refused(tmp_path, keep):
    utm_file(tmp_path / "in.las", UTM + np.zeros((100, 3)))
    whole = (tmp_path / "in.las").read_bytes()
    (tmp_path / "cut.las").write_bytes(whole[:keep])
    with pytest.raises(ValueError, match=r"cut\.las"):
        point_files.read_point_cloud(tmp_path / "cut.las")


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
        las.write_las(stream, adapters.CloudArrays(cloud.points, POINTS), out == ".laz", path)
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
        las.write_las(
            stream, adapters.CloudArrays(cloud.points, POINTS / 9), False, tmp_path / "a.las"
        )
    assert np.array_equal(laspy.read(tmp_path / "b.las").NormalX, POINTS[:, 0] / 9)
