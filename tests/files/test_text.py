"""Delimited text: any delimiter and decimal sign, names and counts; no point more or less."""

from __future__ import annotations

import numpy as np
import pytest

from o3d_sofnn.files import point_files

POINTS = np.round(np.random.default_rng(0).uniform(-900.0, 900.0, (40, 3)), 4)
ROWS = [[f"{value:.4f}" for value in point] for point in POINTS]


def lines(delimiter=" ", decimal=".", end="\n", behind=None):
    """Return the points as text, with further columns behind the coordinates."""
    rows = [row + ([] if behind is None else list(behind[i])) for i, row in enumerate(ROWS)]
    return "".join(delimiter.join(row).replace(".", decimal) + end for row in rows)


def read(folder, text, name="scan.xyz", encoding="utf-8"):
    (folder / name).write_bytes(text.encode(encoding))
    return point_files.read_points(folder / name)


@pytest.mark.parametrize("name", ["a.xyz", "a.txt", "a.csv", "a.asc", "a.pts", "A.XYZ"])
@pytest.mark.parametrize(
    ("delimiter", "decimal"),
    [
        *((delimiter, ".") for delimiter in (" ", "   ", "\t", ",", ", ", ";", "|")),
        *((delimiter, ",") for delimiter in (" ", "\t", ";", "; ", "|")),
    ],
)
def test_every_delimiter_and_decimal_sign(tmp_path, name, delimiter, decimal):
    file = read(tmp_path, lines(delimiter, decimal), name)
    assert np.array_equal(file.points, POINTS)
    assert file.notes == ()


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"]
)
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", " \n", ",\n", "\n\n"])
def test_every_encoding_and_end_of_line(tmp_path, encoding, end):
    assert np.array_equal(read(tmp_path, lines(",", end=end), encoding=encoding).points, POINTS)


@pytest.mark.parametrize(
    "before",
    [
        "x y z\n",
        "# x y z\n",
        "# made by X\n# n=40\n\n",
        "//X Y Z\n40\n",
        "40\n",
        "% x\n",
        "X Y Z\n40\n",
    ],
)
def test_what_stands_before_the_points(tmp_path, before):
    file = read(tmp_path, before + lines() + "# the end\n\n")
    assert np.array_equal(file.points, POINTS)
    assert file.notes == ()


def test_a_title_is_said(tmp_path):
    file = read(tmp_path, "Exported by X\n" + lines())
    assert np.array_equal(file.points, POINTS)
    assert file.notes == ("line 1 left out: 'Exported by X'",)


def test_columns_are_known_by_their_names(tmp_path):
    rng = np.random.default_rng(1)
    normals, colors = rng.normal(size=(40, 3)).round(3), rng.integers(0, 256, (40, 3))
    gray = rng.random((40, 1)).round(3)
    behind = np.hstack([gray, colors, normals]).astype(str)
    text = "x,y,z,Intensity,R,G,B,nx,ny,nz\n" + lines(",", behind=behind)
    file = read(tmp_path, text, "scan.csv")
    assert np.array_equal(file.points, POINTS)
    assert np.array_equal(file.normals, normals)
    assert np.array_equal(file.attributes["colors"], colors)
    assert file.attributes["colors"].dtype == np.uint8
    assert np.array_equal(file.attributes["Intensity"], gray)
    assert set(file.attributes) == {"colors", "Intensity"}


def test_coordinates_in_another_order(tmp_path):
    behind = [[str(i)] for i in range(40)]
    file = read(tmp_path, "z;y;x;label\n" + lines(";", behind=behind))
    assert np.array_equal(file.points, POINTS[:, ::-1])
    assert np.array_equal(file.attributes["label"][:, 0], np.arange(40))


def test_columns_without_names_keep_what_they_are(tmp_path):
    rng = np.random.default_rng(2)
    unit = rng.normal(size=(40, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    levels, other = rng.integers(0, 256, (40, 3)), rng.uniform(0, 9, (40, 2)).round(2)
    file = read(tmp_path, lines(behind=unit.round(6).astype(str)))
    assert np.array_equal(file.normals, unit.round(6))
    file = read(tmp_path, lines(behind=np.hstack([levels, unit.round(6)]).astype(str)))
    assert np.array_equal(file.attributes["colors"], levels)
    assert np.array_equal(file.normals, unit.round(6))
    file = read(tmp_path, lines(behind=other.astype(str)))
    assert np.array_equal(file.attributes["column_5"][:, 0], other[:, 1])
    assert file.notes == ("columns without names kept as column_4 column_5",)
    file = read(tmp_path, lines(behind=(levels / 255).round(6).astype(str)), "scan.xyzrgb")
    assert np.array_equal(file.attributes["colors"], (levels / 255).round(6))
    file = read(tmp_path, lines(behind=(2 * unit).round(6).astype(str)), "scan.xyzn")
    assert np.array_equal(file.normals, (2 * unit).round(6))


def test_words_and_gaps_in_columns(tmp_path):
    behind = [["tree" if i % 2 else "rock", ""] if i % 3 else ["", "7"] for i in range(40)]
    behind[0] = ["tree", "1"]
    file = read(tmp_path, "x,y,z,kind,level\n" + lines(",", behind=behind), "scan.csv")
    assert np.array_equal(file.points, POINTS)
    expected = [1.0] + [np.nan if i % 3 else 7.0 for i in range(1, 40)]
    np.testing.assert_array_equal(file.attributes["level"][:, 0], expected)
    assert file.notes == ("columns left out, which are no numbers: 4",)
    quoted = "".join(",".join(f'"{value}"' for value in row) + "\n" for row in ROWS)
    assert np.array_equal(read(tmp_path, quoted, "scan.csv").points, POINTS)


def test_names_that_are_no_coordinates(tmp_path):
    file = read(tmp_path, "lon;lat;alt\n" + lines(";"))
    assert np.array_equal(file.points, POINTS)
    assert file.notes == ("no columns x y z: taken from lon lat alt",)


def test_pts_with_several_scans_and_without_counts(tmp_path):
    assert np.array_equal(read(tmp_path, f"BEGIN\n{lines()}END\n", "a.pts").points, POINTS)
    both = read(tmp_path, f"40\n{lines()}40\n{lines()}", "b.pts")
    assert np.array_equal(both.points, np.vstack([POINTS, POINTS]))
    behind = [["-1583", "10", "20", "30"] for _ in range(40)]
    leica = read(tmp_path, "40\n" + lines(behind=behind), "c.pts")
    assert np.array_equal(leica.attributes["colors"], np.tile([10, 20, 30], (40, 1)))
    assert np.array_equal(leica.attributes["intensity"], np.full((40, 1), -1583.0))


@pytest.mark.parametrize("place", [1, 2, 20, 40])
@pytest.mark.parametrize(
    "bad",
    ["1 2", "1 2 3 4", "1 2 three", "1 2 0x10", "1 2 1_0", "1 2 1,5", "1 2 1.2.3", "nonsense"],
)
@pytest.mark.parametrize("name", ["a.xyz", "a.pts"])
def test_a_line_that_is_no_row_is_named(tmp_path, place, bad, name):
    rows = lines().splitlines()
    rows[place - 1] = bad
    if (place, bad) in ((1, "nonsense"), (1, "1 2 3 4")):
        return  # a title; and a first row says how many columns there are
    # A decimal comma in the first row is one in all.
    place, bad = (2, rows[1]) if (place, bad) == (1, "1 2 1,5") else (place, bad)
    with pytest.raises(ValueError, match=rf"{name}: line {place}: expected") as caught:
        read(tmp_path, "\n".join(rows) + "\n", name)
    assert repr(bad) in str(caught.value)


@pytest.mark.parametrize("announced", [39, 41, 0, 10**30])
@pytest.mark.parametrize("name", ["a.xyz", "a.pts"])
def test_more_or_fewer_rows_than_announced(tmp_path, announced, name):
    with pytest.raises(ValueError, match=rf"{name}: expected \d+ points as it says, got 40"):
        read(tmp_path, f"{announced}\n{lines()}", name)


def test_a_second_scan_cut_short(tmp_path):
    cut = "".join(lines().splitlines(keepends=True)[:-3])
    with pytest.raises(ValueError, match="expected 40 points as it says, got 37"):
        read(tmp_path, f"40\n{lines()}40\n{cut}", "a.pts")


def test_the_last_number_cut_short(tmp_path):
    for keep in range(1, 6):
        with pytest.raises(ValueError, match=r"cut short|expected 3 numbers"):
            read(tmp_path, lines()[: -1 - keep])
        with pytest.raises(ValueError, match=r"cut short|expected 3 numbers"):
            read(tmp_path, lines()[: -1 - keep], encoding="utf-16")
    # Nothing is missing but the end of the line, or the numbers have no fixed form.
    assert len(read(tmp_path, lines()[:-1]).points) == 40
    free = "".join(" ".join(map(repr, point)) + "\n" for point in (POINTS / 3).tolist())
    assert len(read(tmp_path, free[:-2]).points) == 40


@pytest.mark.parametrize("text", ["nonsense\n", "a b c\n" * 5, "1 2\n", "\0\1\2" * 9])
def test_no_points_but_contents(tmp_path, text):
    with pytest.raises(ValueError, match=r"scan\.xyz: "):
        read(tmp_path, text)


def test_names_in_another_encoding_are_said(tmp_path):
    (tmp_path / "scan.csv").write_bytes("x;y;z;Höhe\n1;2;3;4\n5;6;7;8\n".encode("latin-1"))
    file = point_files.read_points(tmp_path / "scan.csv")
    assert list(file.attributes) == ["H\ufffdhe"]
    assert file.notes == ("names of columns are no UTF-8, some letters are lost: H\ufffdhe",)


def test_nothing_but_comments_is_empty(tmp_path):
    assert read(tmp_path, "# x y z\n\n").points.shape == (0, 3)
