"""What is compared and measured: inputs, figures, colours and charts, one function at a time."""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest
import shapes
from report_page import Page, read_csv

from o3d_sofnn.cli import comparison
from o3d_sofnn.compare import cases, charts, measure, peers, report, run
from o3d_sofnn.geometry import mesh_properties

o3d = pytest.importorskip("open3d")


def test_a_closed_mesh_is_a_model_with_outward_triangles(tmp_path):
    ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 8)
    ball.triangles = o3d.utility.Vector3iVector(np.asarray(ball.triangles)[:, ::-1])
    o3d.io.write_triangle_mesh(str(tmp_path / "ball.stl"), ball.compute_triangle_normals())
    model = cases.read(tmp_path / "ball.stl")
    assert isinstance(model, cases.Model)
    assert mesh_properties.signed_volume(model.vertices, model.triangles) > 0
    assert isinstance(cases.read(tmp_path / "ball.stl", clouds_only=True), np.ndarray)
    sheet = o3d.geometry.TriangleMesh(ball)
    sheet.triangles = o3d.utility.Vector3iVector(np.asarray(ball.triangles)[:-4])
    o3d.io.write_triangle_mesh(str(tmp_path / "sheet.ply"), sheet)
    assert isinstance(cases.read(tmp_path / "sheet.ply"), np.ndarray)


def test_inputs_of_the_same_name_are_told_apart(tmp_path):
    files = [tmp_path / "a" / "scan.ply", tmp_path / "b" / "scan.ply", tmp_path / "scan.xyz"]
    named = cases.sources(files, cases.View(), clouds_only=False)
    assert [source.name for source in named] == ["scan", "scan~2", "scan~3"]
    files.append(tmp_path / "scan~2.ply")
    named = cases.sources(files, cases.View(), clouds_only=False)
    assert len({source.name for source in named}) == len(files)


HOSTILE = (
    '{{scenes}}" autofocus onfocus="window.hurt = 1',
    "<img src=x onerror='window.hurt = 1'>",
    "{{policy}} {{nonsense}}",
    "=1+1",
    "+1",
    "-1",
    "@SUM(A1)",
    "\tx",
    "two\nlines",
    "\udcff",  # a byte that is no UTF-8
    "点" * 83,
)


def test_names_of_files_are_text_in_the_report(tmp_path):
    case = cases.Case(HOSTILE[0], shapes.torus(100).points)
    rows = [run._row(name, None, None, "", f"not read: {name}") for name in HOSTILE]
    rows.append(run._row(case.input, 100, None, "ours", "failed"))
    scene = run.Scene(case.title, case.view)
    scene.add(rows[-1], None)
    report.write(tmp_path / "report.html", rows, [scene])
    page = Page(tmp_path / "report.html")
    columns = page.titles["results"]
    shown = [dict(zip(columns, row, strict=False))["input"] for row in page.rows["results"][1:]]
    expected = [row["input"].replace("\udcff", "\\udcff") for row in rows]
    assert shown == [(name, name) for name in expected]
    assert page.data["scenes"][0]["title"] == case.title
    assert {tag: page.tags[tag] for tag in ("script", "meta", "link", "img", "svg")} == {
        "script": 3,
        "meta": 3,
        "link": 1,
        "img": 0,
        "svg": 0,
    }
    assert not any(name.startswith("on") for name in page.attributes)


def test_names_of_files_are_no_formulas_in_the_csv(tmp_path):
    rows = [run._row(name, 5, -1.0, "ours", f"{name}: not read") for name in HOSTILE]
    run._write_csv(tmp_path / "results.csv", rows)
    found = read_csv(tmp_path / "results.csv")
    for row, name in zip(found, HOSTILE, strict=True):
        assert row["input"].removeprefix("'") == name.replace("\udcff", "\\udcff")
        for key in ("input", "error"):
            assert not row[key].startswith(("=", "+", "-", "@", "\t", "\r", "\n"))
        assert float(row["noise"]) == -1.0
    assert [row["input"][0] == "'" for row in found] == [name[0] in "=+-@\t" for name in HOSTILE]


@pytest.mark.parametrize("name", HOSTILE)
def test_pictures_are_named_after_any_file(tmp_path, name):
    look = two_pictures()
    for noise in (None, 0.5):
        case = cases.Case(name, shapes.torus(100).points, noise)
        run._write_pictures(case, "meshlab_ball_pivoting", look, tmp_path)
    assert len(list(tmp_path.iterdir())) == 4
    other = cases.Case(name + "x", shapes.torus(100).points)
    run._write_pictures(other, "meshlab_ball_pivoting", look, tmp_path)
    assert len(list(tmp_path.iterdir())) == 6


def two_pictures():
    return run.Look(*(np.zeros((0, 3)),) * 3, None, None, {"surface": b"1", "flipped": b"2"})


def test_figures_of_a_known_mesh():
    ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 40)
    vertices, triangles = np.asarray(ball.vertices), np.asarray(ball.triangles)
    outward = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    truth = measure.Truth(vertices, triangles, outward)
    larger = peers.Mesh(1.01 * vertices, triangles, -outward)
    found = measure.figures(vertices, larger, truth, 20_000)
    unit = 1e-3 * np.linalg.norm(np.ptp(vertices, axis=0))
    assert found["chamfer"] == pytest.approx(0.01 / unit, rel=0.01)
    assert found["input_mean"] == pytest.approx(0.01 / unit, rel=0.01)
    assert (found["holes"], found["components"], found["watertight"]) == (0, 1, 1)
    assert found["normal_consistency"] == pytest.approx(1.0, abs=0.01)
    assert found["flipped"] == 100.0
    assert found["f_score"] == 0.0  # 2.9 thousandths off, the threshold is 2
    opened = peers.Mesh(vertices, triangles[:-5], outward)
    assert measure.figures(vertices, opened, truth, 1000)["holes"] >= 1


def side_row(method, flipped, consistency, chamfer=1.0):
    figures = {"flipped": flipped, "normal_consistency": consistency, "chamfer": chamfer}
    return run._row("ball", 900, 0.0, method, "") | figures


@pytest.mark.parametrize(
    ("flipped", "consistency", "expected"),
    [
        (98.0, -0.9, (2.0, 0.9)),
        (98.0, 0.9, (2.0, 0.9)),
        (50.0, -0.9, (50.0, 0.9)),
        (None, -0.9, (None, 0.9)),
        (50.0, 0.9, None),
        (0.0, None, None),
        (None, None, None),
    ],
)
def test_sides_that_are_wrong_as_a_whole_are_turned_once(flipped, consistency, expected):
    row = side_row("ours", flipped, consistency)
    found = measure.turned(row)
    if expected is None:
        assert found is None
    else:
        assert (found["flipped"], found["normal_consistency"]) == expected
        assert measure.turned(found) is None
        assert {key for key in row if row[key] != found[key]} <= {"flipped", "normal_consistency"}


def test_the_report_has_a_second_row_for_turned_sides(tmp_path):
    rows = [
        side_row("ours", 0.0, 0.99),
        side_row("open3d_poisson", 98.0, -0.9, chamfer=2.0),
        side_row("open3d_poisson", 4.0, 0.8, chamfer=4.0),
    ]
    report.write(tmp_path / "report.html", rows, [])
    page = Page(tmp_path / "report.html")
    titles = {table: [cells[0][1] for cells in page.rows[table][1:]] for table in page.rows}
    second = "Open3D Poisson, with the sides turned once"
    assert titles["results"] == ["o3d_sofnn", "Open3D Poisson", second, "Open3D Poisson"]
    assert titles["summary"] == ["o3d_sofnn", "Open3D Poisson", second]
    lines = [
        dict(zip(page.titles["summary"], row, strict=True)) for row in page.rows["summary"][1:]
    ]
    assert [float(line["flipped"][0]) for line in lines] == [0.0, 51.0, 3.0]
    assert [float(line["chamfer"][0]) for line in lines] == [1.0, 3.0, 3.0]
    assert (tmp_path / "report.html").read_text(encoding="utf-8").count('class="best"') == 6


def test_errors_on_a_scan_begin_beyond_the_neighbours():
    from o3d_sofnn.compare.evaluate import WORST, surface_errors

    side = np.linspace(0.0, 1.0, 21)
    points = np.stack(np.meshgrid(side, side, [0.0]), axis=-1).reshape(-1, 3)
    places = np.array([[0.525, 0.525, 0.0], [0.5, 0.5, 0.0], [0.5, 0.5, 0.08], [0.5, 0.5, 1.0]])
    found = surface_errors(cases.Case("sheet", points), places)
    usual = 0.05 * np.sqrt(2.0)  # to the sixth neighbour of a grid
    np.testing.assert_allclose(found, [0, 0, (0.08 - usual) / (WORST * np.sqrt(2.0)), 1])


def row_of(name, points, seconds):
    return {"input": name, "method": "ours", "error": "", "noise": None} | {
        "points": points,
        "seconds": seconds,
    }


def test_time_over_size_needs_several_sizes_of_one_input():
    (chart,) = [chart for chart in charts.CHARTS if chart.name == "time-size"]
    rows = [row_of("a", 5000, 1.0), row_of("b", 9000, 2.0)]
    assert charts.draw(chart, rows, ["ours"], report.TITLES) == ""
    rows.append(row_of("b", 20000, 4.0))
    drawn = charts.draw(chart, rows, ["ours"], report.TITLES)
    assert re.findall(r'data-x="(\d+)', drawn) == ["9000", "20000"]
    labels = [float(x) for x in re.findall(r'<text x="([\d.]+)" y="290', drawn)]
    assert len(labels) > 1
    assert (np.diff(labels) >= charts.LABEL).all()


def test_a_method_without_its_library_says_what_to_type(monkeypatch):
    pytest.importorskip("meshlab_sofnn", reason="the filters are not on the path")
    from o3d_sofnn.compare import evaluate

    for name in [name for name in sys.modules if name.startswith("meshlab_sofnn")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pymeshlab", None)
    case = cases.Case("ring", shapes.torus(100).points)
    with pytest.raises(RuntimeError, match="pip install pymeshlab"):
        evaluate.evaluate(case, "meshlab_poisson", 100, 100)


def test_methods_have_titles_and_colours_and_are_in_the_help():
    from o3d_sofnn.compare.evaluate import METHODS as ALL

    assert set(report.TITLES) == {"", "input", *ALL}
    assert len(charts.COLORS) == len(ALL)
    assert set(ALL) <= set(re.findall(r"\w+", comparison.TEXT))
