"""The command line where something is missing: streams, working directory, temporary folder."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapes

from o3d_sofnn.cli import main, streams
from o3d_sofnn.compare import isolated
from o3d_sofnn.progress import ProgressBar, make_progress, printable

o3d = pytest.importorskip("open3d")


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    np.savetxt(tmp_path / "scan.xyz", shapes.torus(400).points)
    return tmp_path / "scan.xyz"


def test_it_works_with_nothing_but_the_two_files(tmp_path: Path, scan: Path) -> None:
    """No standard streams, no temporary folder, and the longest of names."""
    name = "点" * 83 + ".ply"
    assert len(os.fsencode(name)) == 253
    nowhere = {"TMPDIR": str(tmp_path / "none"), "TEMP": str(tmp_path / "none")}
    process = subprocess.run(
        [sys.executable, "-m", "o3d_sofnn", "normals", str(scan), str(tmp_path / name)],
        env=os.environ | nowhere,
        preexec_fn=lambda: [os.close(descriptor) for descriptor in range(3)],
        cwd=tmp_path,
    )
    assert process.returncode == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([scan.name, name])
    cloud = o3d.io.read_point_cloud(str(tmp_path / name))
    assert np.allclose(np.linalg.norm(np.asarray(cloud.normals), axis=1), 1.0)


@pytest.mark.parametrize("command", ["normals", "reconstruct"])
def test_a_warning_is_one_line(tmp_path: Path, command: str) -> None:
    points = shapes.torus(400).points
    points[3] = np.nan
    np.savetxt(tmp_path / "scan.xyz", points)
    process = subprocess.run(
        [sys.executable, "-m", "o3d_sofnn", command, "scan.xyz", "out.ply"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    said = "1 of 400 points are not finite (NaN or inf) and were left out"
    assert process.stderr == f"o3d-sofnn: WARNING: {said}\n"


@pytest.mark.parametrize("options", [["--json", "-"], ["--progress", "plain"]])
def test_a_closed_standard_output_is_said_before_the_work(
    tmp_path: Path, scan: Path, capsys: pytest.CaptureFixture[str], monkeypatch, options
) -> None:
    monkeypatch.setattr(sys, "stdout", None)
    assert main.main(["normals", str(scan), str(tmp_path / "out.ply"), *options]) == main.FAILURE
    assert capsys.readouterr().err == "o3d-sofnn: error: standard output: closed\n"
    assert not (tmp_path / "out.ply").exists()
    assert sys.stdout is None


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_standard_output_is_a_failure(
    tmp_path: Path, scan: Path, capsys: pytest.CaptureFixture[str], monkeypatch
) -> None:
    with open("/dev/full", "w") as full:  # closing it fails, unless what is left was given up
        monkeypatch.setattr(sys, "stdout", full)
        code = main.main(["normals", str(scan), str(tmp_path / "out.ply"), "--json", "-"])
    assert code == main.FAILURE
    message = "o3d-sofnn: error: standard output: No space left on device\n"
    assert capsys.readouterr().err == message


def test_without_a_standard_error_stream(tmp_path: Path, scan: Path, monkeypatch) -> None:
    import o3d_sofnn

    monkeypatch.setattr(sys, "stderr", None)
    assert main.main(["normals", str(scan), str(tmp_path / "out.doc")]) == main.BAD_INPUT
    with pytest.raises(SystemExit) as caught:
        main.main(["normals", str(scan)])
    assert caught.value.code == main.BAD_INPUT
    assert sys.stderr is None
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(shapes.torus(400).points))
    o3d_sofnn.estimate_normals(cloud, print_progress=True)
    assert cloud.has_normals()
    make_progress("auto")(0.5, "half")


def test_a_bar_on_a_terminal_that_is_gone() -> None:
    read, write = os.pipe()
    os.close(read)
    stream = open(write, "w")  # noqa: SIM115 - closing it fails, as writing does
    bar = ProgressBar(stream)
    bar(0.1, "first")
    bar(0.2, "second")
    bar.close()
    with pytest.raises(BrokenPipeError):
        stream.close()


def test_letters_that_a_stream_has_not_are_escaped(tmp_path: Path) -> None:
    with open(tmp_path / "ascii", "w", encoding="ascii") as stream:
        guarded = streams._Stream(stream, "standard output", wanted=True)
        guarded.write("点 \udcff\n")
        guarded.flush()
    assert (tmp_path / "ascii").read_text(encoding="ascii") == "\\u70b9 \\udcff\n"


def test_names_of_files_do_not_speak_to_the_terminal(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    name = "a\x1b[31m\nb\udcff.ply"
    assert main.main(["normals", str(tmp_path / name), "out.ply"]) == main.BAD_INPUT
    err = capfd.readouterr().err
    assert err.count("\n") == 1
    assert "a\\x1b[31m b\\udcff.ply: not readable" in err
    assert printable("point 点 \t two\u2028lines\x9b") == "point 点 two lines\\x9b"


@pytest.mark.parametrize("command", ["normals", "reconstruct", "compare"])
def test_a_working_directory_that_is_gone(
    tmp_path: Path, scan: Path, capfd: pytest.CaptureFixture[str], monkeypatch, command
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    output = ["--out"] * (command == "compare") + [str(tmp_path / "out.ply")]
    assert main.main([command, str(scan), *output]) == main.FAILURE
    message = "o3d-sofnn: error: the working directory: not there any more\n"
    assert capfd.readouterr() == ("", message)


def test_without_a_temporary_folder_compare_says_so(
    tmp_path: Path, scan: Path, capfd: pytest.CaptureFixture[str], monkeypatch
) -> None:
    def missing() -> None:
        raise FileNotFoundError(2, "No usable temporary directory found in ['/tmp']")

    monkeypatch.setattr(isolated.tempfile, "TemporaryDirectory", missing)
    options = ["--out", str(tmp_path / "out"), "--quick", "--methods", "ours"]
    assert main.main(["compare", str(scan), *options]) == main.FAILURE
    message = "o3d-sofnn: error: No usable temporary directory found in ['/tmp']\n"
    assert capfd.readouterr() == ("", message)
