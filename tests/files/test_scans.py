"""Scans that say where their scanner stood: PTX, E57; LAS with its coordinate system."""

from __future__ import annotations

import numpy as np
import pytest

from o3d_sofnn.files import point_files

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
