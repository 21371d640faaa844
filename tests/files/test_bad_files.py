"""Files that cannot be read, and places that cannot be written."""

from __future__ import annotations

import errno
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
import shapes

from o3d_sofnn import adapters
from o3d_sofnn.cli import main
from o3d_sofnn.files import point_files
from o3d_sofnn.operators import normals, surfaces

o3d = pytest.importorskip("open3d")


@pytest.fixture
def scan(tmp_path):
    path = tmp_path / "scan.ply"
    point_files.write_point_cloud(
        path, adapters.make_cloud(adapters.CloudArrays(shapes.sphere().points))
    )
    return path


def complaint(capfd):
    """Return the one line that the command line wrote."""
    out, err = capfd.readouterr()
    assert out == ""
    assert err.startswith("o3d-sofnn: error: ")
    assert err.count("\n") == 1
    return err


@pytest.mark.parametrize(
    ("name", "contents"),
    [
        ("bad.ply", b"nonsense"),
        ("bad.pcd", b"nonsense"),
        ("bad.npz", b"nonsense"),
        ("bad.obj", b"nonsense"),
        ("bad.las", b"nonsense" * 100),
        (
            "cut.ply",
            b"ply\nformat ascii 1.0\nelement vertex 9\nproperty float x\n"
            b"property float y\nproperty float z\nend_header\n0 0 0\n",
        ),
    ],
)
def test_files_with_unreadable_contents(tmp_path, capfd, name, contents):
    (tmp_path / name).write_bytes(contents)
    with pytest.raises(ValueError, match=name):
        point_files.read_point_cloud(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_files_that_are_not_there_or_no_files(tmp_path):
    with pytest.raises(FileNotFoundError):
        point_files.read_point_cloud(tmp_path / "none.ply")
    (tmp_path / "folder.ply").mkdir()
    with pytest.raises(IsADirectoryError):
        point_files.read_point_cloud(tmp_path / "folder.ply")
    with pytest.raises(ValueError, match=r"endings .*\.ply.*, got \.doc"):
        point_files.read_point_cloud(tmp_path / "letter.doc")


def test_what_is_left_out_is_logged_and_reported(tmp_path, capfd):
    rows = "".join(f"{x} {y} {x * y * 0.1} 7\n" for x in range(9) for y in range(9))
    (tmp_path / "scan.xyz").write_text(rows)
    note = "columns without names kept as column_4"
    output, report = tmp_path / "out.ply", tmp_path / "report.json"
    arguments = ["normals", str(tmp_path / "scan.xyz"), str(output), "--json", str(report)]
    assert main.main(arguments) == 0
    assert f"WARNING: {tmp_path / 'scan.xyz'}: {note}\n" in capfd.readouterr().err
    assert note in json.loads(report.read_text())["warnings"]


@pytest.mark.parametrize("command", ["normals", "reconstruct"])
@pytest.mark.parametrize("name", ["none.ply", "folder.ply", "bad.ply", "empty.xyz", "letter.doc"])
def test_the_command_line_says_what_is_wrong_with_the_file(tmp_path, capfd, command, name):
    (tmp_path / "folder.ply").mkdir()
    for file in ("bad.ply", "letter.doc"):
        (tmp_path / file).write_text("nonsense")
    (tmp_path / "empty.xyz").touch()
    output = tmp_path / "out.ply"
    assert main.main([command, str(tmp_path / name), str(output)]) == main.BAD_INPUT
    assert name in complaint(capfd)
    assert not output.exists()


def test_a_file_without_permission(tmp_path, capfd, monkeypatch, scan):
    def refuse(self, *args, **kwargs):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))

    # Real permissions do not stop root, as whom tests run in containers.
    monkeypatch.setattr(point_files.reading, "read", lambda path, ending: refuse(path))
    assert main.main(["normals", str(scan), str(tmp_path / "out.ply")]) == main.BAD_INPUT
    assert "Permission denied" in complaint(capfd)


@pytest.fixture
def no_work(monkeypatch):
    """Fail the test when an operator runs: what can be known before must be said before."""
    for module, name in ((normals, "estimate_normals"), (surfaces, "reconstruct_surface")):
        monkeypatch.setattr(module, name, lambda *_, **__: pytest.fail("computed in vain"))


@pytest.mark.usefixtures("no_work")
def test_a_read_only_folder(tmp_path, capfd, monkeypatch, scan):
    path_open = Path.open

    def read_only(self, mode="r", *args, **kwargs):
        if mode.startswith("r"):
            return path_open(self, mode, *args, **kwargs)
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(self))

    monkeypatch.setattr(Path, "open", read_only)
    output = tmp_path / "out.ply"
    assert main.main(["normals", str(scan), str(output)]) == main.FAILURE
    line = complaint(capfd)
    assert "Read-only file system" in line
    assert str(output) in line


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("command", ["normals", "reconstruct"])
@pytest.mark.parametrize("output", ["scan.ply", "link.ply", "./none/../scan.ply", "hard.ply"])
def test_an_output_that_is_the_input(tmp_path, capfd, monkeypatch, scan, command, output):
    (tmp_path / "link.ply").symlink_to(scan)
    (tmp_path / "hard.ply").hardlink_to(scan)
    (tmp_path / "none").mkdir()
    monkeypatch.chdir(tmp_path)
    before = scan.read_bytes()
    for arguments in ([output], ["out.ply", "--json", output], [output, "--json", "report.json"]):
        assert main.main([command, "scan.ply", *arguments]) == main.BAD_INPUT
        assert f"{Path(output)}: expected another file than" in complaint(capfd)
        assert main.main([command, str(scan), *arguments]) == main.BAD_INPUT
        complaint(capfd)
    assert scan.read_bytes() == before
    assert not (tmp_path / "out.ply").exists()


@pytest.mark.usefixtures("no_work")
def test_a_report_that_is_the_output(tmp_path, capfd, scan):
    (tmp_path / "link.json").symlink_to(tmp_path / "out.ply")
    for report in ("out.ply", "link.json"):
        arguments = [str(scan), str(tmp_path / "out.ply"), "--json", str(tmp_path / report)]
        assert main.main(["normals", *arguments]) == main.BAD_INPUT
        assert "expected another file than" in complaint(capfd)


@pytest.mark.usefixtures("no_work")
def test_what_las_cannot_hold_is_said_before_the_work(tmp_path, capfd):
    points = shapes.sphere().points
    points[3] = float("nan")
    path = tmp_path / "scan.ply"
    point_files.write_point_cloud(path, adapters.make_cloud(adapters.CloudArrays(points)))
    assert main.main(["normals", str(path), str(tmp_path / "out.las")]) == main.BAD_INPUT
    assert "expected finite coordinates for LAS" in complaint(capfd)


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("place", ["scan.ply/out.ply", "none/out.ply"])
def test_a_folder_that_is_none(tmp_path, capfd, scan, place):
    assert main.main(["normals", str(scan), str(tmp_path / place)]) == main.FAILURE
    assert complaint(capfd).startswith(f"o3d-sofnn: error: {tmp_path / place}: No")


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("name", ["out.doc", "out", "folder.ply"])
@pytest.mark.parametrize("command", ["normals", "reconstruct"])
def test_an_output_of_the_wrong_kind(tmp_path, capfd, scan, command, name):
    (tmp_path / "folder.ply").mkdir()
    assert main.main([command, str(scan), str(tmp_path / name)]) == main.BAD_INPUT
    assert name in complaint(capfd)


@pytest.mark.parametrize(
    ("ending", "old"),
    [(".ply", None), *((end, b"old") for end in (".ply", ".xyz", ".pcd", ".npz", ".las", ".laz"))],
)
def test_a_full_disk_leaves_the_output_as_it_was(tmp_path, scan, ending, old):
    output = tmp_path / f"out{ending}"
    if old is not None:
        output.write_bytes(old)
    before = sorted(tmp_path.iterdir())
    limit = 20_000  # bytes per file: the system refuses more, as on a full disk
    process = subprocess.run(
        [sys.executable, "-m", "o3d_sofnn", "normals", str(scan), str(output)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert process.returncode == main.FAILURE, process.stderr
    assert process.stderr.count("\n") == 1
    assert str(output) in process.stderr
    assert sorted(tmp_path.iterdir()) == before
    assert old is None or output.read_bytes() == old


@pytest.mark.parametrize("ending", [".ply", ".obj", ".off", ".stl"])
def test_a_full_disk_leaves_no_half_mesh(tmp_path, scan, ending, capfd, monkeypatch):
    def full(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    output = tmp_path / f"out{ending}"
    assert main.main(["reconstruct", str(scan), str(output)]) == main.FAILURE
    assert "No space left on device" in complaint(capfd)
    assert list(tmp_path.iterdir()) == [scan]
