"""The command line: the same results as the functions, reports, progress, Ctrl-C."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import numpy as np
import pytest
import shapes
from mesh_checks import assert_valid_mesh

import o3d_sofnn
from o3d_sofnn.cli import main

o3d = pytest.importorskip("open3d")

N = 1500
COMMAND = [sys.executable, "-m", "o3d_sofnn"]


def run(command, folder):
    """Return what ``command`` says; run elsewhere, so that it takes the installed package."""
    process = subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder)
    return process.stdout


def write_scan(path, shape, colors=None):
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(shape.points))
    if colors is not None:
        cloud.colors = o3d.utility.Vector3dVector(colors)
    o3d.io.write_point_cloud(str(path), cloud)
    return path


@pytest.fixture
def scan(tmp_path):
    shape = shapes.torus(N)
    return write_scan(tmp_path / "scan.ply", shape, colors=np.abs(shape.normals))


def test_normals_are_those_of_the_function_bit_for_bit(tmp_path, scan):
    output = tmp_path / "out.ply"
    assert main.main(["normals", str(scan), str(output)]) == 0
    by_hand = o3d_sofnn.estimate_normals(o3d.io.read_point_cloud(str(scan)))
    result = o3d.io.read_point_cloud(str(output))
    assert np.array_equal(np.asarray(result.points), np.asarray(by_hand.points))
    assert np.array_equal(np.asarray(result.normals), np.asarray(by_hand.normals))
    assert np.array_equal(np.asarray(result.colors), np.asarray(by_hand.colors))


def test_the_mesh_is_that_of_the_function_bit_for_bit(tmp_path, scan):
    output = tmp_path / "out.ply"
    assert main.main(["reconstruct", str(scan), str(output)]) == 0
    by_hand = o3d_sofnn.reconstruct_surface(o3d.io.read_point_cloud(str(scan)))
    result = o3d.io.read_triangle_mesh(str(output))
    assert_valid_mesh(result, components=1)
    for name in ("vertices", "triangles", "vertex_normals"):
        assert np.array_equal(getattr(result, name), getattr(by_hand, name)), name
    # The file has 256 levels.
    colors = np.asarray(result.vertex_colors), np.asarray(by_hand.vertex_colors)
    assert np.abs(colors[0] - colors[1]).max() <= 1.01 / 255


def test_options_reach_the_functions(tmp_path, scan, monkeypatch):
    seen = {}

    def record(name):
        def operator(cloud, **options):
            seen[name] = options
            raise ValueError("seen enough")

        return operator

    from o3d_sofnn.operators import normals, surfaces

    monkeypatch.setattr(normals, "estimate_normals", record("normals"))
    monkeypatch.setattr(surfaces, "reconstruct_surface", record("mesh"))
    out = str(tmp_path / "out.ply")
    common = [str(scan), out, "--max-nn", "40", "--radius", "0.5", "--threads", "2"]
    main.main(["normals", *common, "--viewpoint", "0", "-1.5", "2e3"])
    assert seen["normals"]["viewpoint"] == [0.0, -1.5, 2000.0]
    assert seen["normals"]["towards"] is None
    main.main(["normals", *common, "--viewpoint", "-1e5", "-.5", "-2."])
    assert seen["normals"]["viewpoint"] == [-1e5, -0.5, -2.0]
    main.main(["normals", *common, "--towards", "0", "0", "1"])
    assert seen["normals"]["towards"] == [0.0, 0.0, 1.0]
    assert seen["normals"]["n_threads"] == 2
    main.main(["reconstruct", *common, "--depth", "7", "--trim", "0.3", "--use-normals"])
    mesh = seen["mesh"]
    assert (mesh["depth"], mesh["voxel_size"], mesh["trim"]) == (7, None, 0.3)
    assert mesh["use_normals"] is True
    assert (mesh["max_nn"], mesh["radius"]) == (40, 0.5)
    main.main(["reconstruct", *common, "--voxel-size", "0.25"])
    assert seen["mesh"]["voxel_size"] == 0.25
    main.main(["reconstruct", *common, "--towards", "0", "0", "1"])
    assert (seen["mesh"]["towards"], seen["mesh"]["viewpoint"]) == ([0.0, 0.0, 1.0], None)
    main.main(["reconstruct", *common, "--viewpoint", "1", "2", "3"])
    assert seen["mesh"]["viewpoint"] == [1.0, 2.0, 3.0]


def test_las_in_utm_coordinates(tmp_path):
    laspy = pytest.importorskip("laspy")
    shape = shapes.sphere(N, radius=10.0).moved((5e5, 4.9e6, 100.0))
    data = laspy.LasData(laspy.LasHeader(point_format=0, version="1.4"))
    data.header.offsets, data.header.scales = shape.points[0], [0.001] * 3
    data.x, data.y, data.z = shape.points.T
    data.write(tmp_path / "scan.laz")
    assert main.main(["normals", str(tmp_path / "scan.laz"), str(tmp_path / "out.laz")]) == 0
    back = laspy.read(tmp_path / "out.laz")
    assert np.array_equal(back.X, data.X)
    normals = np.stack([back[f"Normal{axis}"] for axis in "XYZ"], axis=1)
    assert (np.einsum("ij,ij->i", normals, shape.normals) > 0.7).all()
    assert main.main(["reconstruct", str(tmp_path / "scan.laz"), str(tmp_path / "out.ply")]) == 0
    mesh = o3d.io.read_triangle_mesh(str(tmp_path / "out.ply"))
    radii = np.linalg.norm(np.asarray(mesh.vertices) - [5e5, 4.9e6, 100.0], axis=1)
    assert np.abs(radii - 10.0).max() < 0.5


def test_the_vertices_of_a_mesh_file_are_points(tmp_path):
    sphere = o3d.geometry.TriangleMesh.create_sphere(resolution=30)
    o3d.io.write_triangle_mesh(str(tmp_path / "scan.obj"), sphere)
    assert main.main(["reconstruct", str(tmp_path / "scan.obj"), str(tmp_path / "out.obj")]) == 0
    assert_valid_mesh(o3d.io.read_triangle_mesh(str(tmp_path / "out.obj")), components=1)


def test_the_report_of_the_mesh(tmp_path, scan):
    output, destination = tmp_path / "out.ply", tmp_path / "report.json"
    assert main.main(["reconstruct", str(scan), str(output), "--json", str(destination)]) == 0
    report = json.loads(destination.read_text())
    mesh = o3d.io.read_triangle_mesh(str(output))
    assert report["points"] == N
    assert report["vertices"] == len(mesh.vertices)
    assert report["triangles"] == len(mesh.triangles)
    assert report["watertight"] is True
    assert 0 < report["rules"] < N
    assert 0 <= report["outliers"] < N
    seconds = report["seconds"]
    assert {"read", "write", "total"} < set(seconds)
    assert all(value >= 0.0 for value in seconds.values())


def test_the_report_on_the_screen_is_nothing_but_json(tmp_path, scan, capfd):
    assert main.main(["normals", str(scan), str(tmp_path / "out.ply"), "--json", "-"]) == 0
    out, err = capfd.readouterr()
    report = json.loads(out)
    assert err == ""
    assert report["points"] == N
    assert report["command"] == "normals"
    assert "triangles" not in report


def test_rows_that_are_not_finite_are_in_the_report(tmp_path, capfd):
    shape = shapes.sphere(N)
    shape.points[7] = np.nan
    scan = write_scan(tmp_path / "scan.ply", shape)
    assert main.main(["normals", str(scan), str(tmp_path / "out.ply"), "--json", "-"]) == 0
    out, err = capfd.readouterr()
    report = json.loads(out)
    assert "1 of 1500" in report["warnings"][-1]
    assert (report["points"], report["not_finite"]) == (N, 1)
    assert report["outliers"] >= 0
    assert err.startswith("o3d-sofnn: WARNING: 1 of 1500 points")
    result = o3d.io.read_point_cloud(str(tmp_path / "out.ply"))
    assert np.isnan(np.asarray(result.points)[7]).all()
    assert not np.asarray(result.normals)[7].any()


@pytest.mark.parametrize("command", ["normals", "reconstruct"])
def test_progress_lines(tmp_path, scan, capfd, command):
    arguments = [command, str(scan), str(tmp_path / "out.ply"), "--progress", "plain"]
    assert main.main(arguments) == 0
    out, err = capfd.readouterr()
    lines = out.splitlines()
    assert err == ""
    assert all(re.fullmatch(r"PROGRESS \d{1,3} \S.*", line) for line in lines)
    percents = [int(line.split()[1]) for line in lines]
    assert percents == sorted(percents)
    assert percents[0] == 0
    assert percents[-1] == 100
    assert len(set(percents)) > 4


@pytest.mark.parametrize("mode", ["auto", "none"])
def test_nothing_is_said_off_a_terminal(tmp_path, scan, capfd, mode):
    arguments = ["normals", str(scan), str(tmp_path / "out.ply"), "--progress", mode]
    assert main.main(arguments) == 0
    assert capfd.readouterr() == ("", "")


def test_a_bar_on_request(tmp_path, scan, capfd):
    arguments = ["normals", str(scan), str(tmp_path / "out.ply"), "--progress", "bar"]
    assert main.main(arguments) == 0
    out, err = capfd.readouterr()
    assert out == ""
    assert "100 %" in err or "100%" in err  # the second is the bar of tqdm


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["polish", "a.ply", "b.ply"],
        ["normals", "a.ply"],
        ["normals", "a.ply", "b.ply", "--depth", "7"],
        ["normals", "a.ply", "b.ply", "--viewpoint", "1", "2"],
        ["normals", "a.ply", "b.ply", "--viewpoint", "1", "2", "-x"],
        ["normals", "a.ply", "b.ply", "--two\nlines\x1b[31m"],
        ["reconstruct", "a.ply", "b.ply", "--depth", "deep"],
        ["reconstruct", "a.ply", "b.ply", "--trim", "much"],
        ["reconstruct", "a.ply", "b.ply", "--depth", "7", "--voxel-size", "1"],
        ["normals", "a.ply", "b.ply", "--viewpoint", *"123", "--towards", *"123"],
        ["reconstruct", "a.ply", "b.ply", "--use-normals", "--towards", *"123"],
    ],
)
def test_wrong_arguments_are_one_line_and_code_2(capfd, arguments):
    with pytest.raises(SystemExit) as caught:
        main.main(arguments)
    assert caught.value.code == main.BAD_INPUT
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("o3d-sofnn: error: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    "options",
    [
        *(["--max-nn", "-1"], ["--radius", "-1e5"], ["--radius", "nan"], ["--radius", "-inf"]),
        *(["--threads", "0"], ["--threads", "2147483648"], ["--towards", "-nan", "0", "1e999"]),
    ],
)
def test_options_out_of_range_are_one_line_and_code_2(tmp_path, scan, capfd, options):
    arguments = ["normals", str(scan), str(tmp_path / "out.ply"), *options]
    assert main.main(arguments) == main.BAD_INPUT
    out, err = capfd.readouterr()
    assert out == ""
    assert re.match(rf"o3d-sofnn: error: {options[0]}: expected .*got", err)
    assert list(tmp_path.iterdir()) == [scan]


@pytest.mark.parametrize("command", ["normals", "reconstruct"])
def test_points_without_extent_are_one_line_and_code_2(tmp_path, capfd, command):
    (tmp_path / "scan.xyz").write_text("1 2 3\n" * 50)
    arguments = [command, str(tmp_path / "scan.xyz"), str(tmp_path / "out.ply")]
    assert main.main(arguments) == main.BAD_INPUT
    err = capfd.readouterr().err
    assert err.startswith(f"o3d-sofnn: error: {tmp_path / 'scan.xyz'}: points are all equal")


def test_version_and_help(tmp_path):
    assert run([*COMMAND, "--version"], tmp_path) == f"o3d-sofnn {o3d_sofnn.__version__}\n"
    assert "reconstruct" in run([*COMMAND, "--help"], tmp_path)
    assert "--voxel-size" in run([*COMMAND, "reconstruct", "--help"], tmp_path)


def test_importing_the_package_is_cheap(tmp_path):
    code = (
        "import sys, o3d_sofnn, o3d_sofnn.cli.main\n"
        "print([name for name in ('open3d', 'scipy', 'numpy') if name in sys.modules])"
    )
    assert run([sys.executable, "-c", code], tmp_path) == "[]\n"
    assert {"estimate_normals", "reconstruct_surface", "SOFNN"} <= set(dir(o3d_sofnn))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = o3d_sofnn.nonsense
