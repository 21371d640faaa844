"""Several inputs, folders, wildcards and the standard streams."""

from __future__ import annotations

import io
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapes

from o3d_sofnn.cli import commands, main
from o3d_sofnn.files import point_files

POINTS = shapes.torus(400).points


@pytest.fixture
def scans(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Three good files, a bad one and a picture in a folder beside the working directory."""
    folder = tmp_path / "scans"
    folder.mkdir()
    np.savetxt(folder / "a.xyz", POINTS)
    np.save(folder / "b.npy", POINTS)
    np.savetxt(folder / "c[1].xyz", POINTS)
    monkeypatch.chdir(tmp_path)
    return folder


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def lines(capfd: pytest.CaptureFixture[str]) -> list[str]:
    return capfd.readouterr().err.splitlines()


@pytest.mark.parametrize("out", ["out", "out/", "made"])
def test_outputs_go_to_a_folder(scans: Path, capfd: pytest.CaptureFixture[str], out: str) -> None:
    Path("made").mkdir()
    command = ["normals", "scans/a.xyz", "scans/b.npy", "scans/c[1].xyz", out]
    assert main.main(command) == 0
    assert lines(capfd) == []
    assert names(Path(out)) == ["a.ply", "b.ply", "c[1].ply"]
    alone = ["normals", "scans/a.xyz", "alone.ply"]
    assert main.main(alone) == 0
    assert Path(out, "a.ply").read_bytes() == Path("alone.ply").read_bytes()


def test_one_file_may_go_to_a_folder_too(scans: Path) -> None:
    assert main.main(["reconstruct", "scans/a.xyz", "meshes/", "--output-format", "OBJ"]) == 0
    assert names(Path("meshes")) == ["a.obj"]


def test_a_name_with_the_stem(scans: Path) -> None:
    assert main.main(["normals", "scans/a.xyz", "scans/b.npy", "{stem}_n.xyz"]) == 0
    assert {"a_n.xyz", "b_n.xyz"} < set(names(Path()))


def test_options_may_stand_between_files(scans: Path) -> None:
    command = ["normals", "scans/a.xyz", "scans/b.npy", "--threads", "1", "scans/c[1].xyz", "out"]
    assert main.main(command) == 0
    assert len(names(Path("out"))) == 3


@pytest.mark.parametrize("given", ["scans", "scans/*", "sc*/?*.*", "**/*.??*", "scans/[!z]*"])
def test_folders_and_wildcards(scans: Path, capfd: pytest.CaptureFixture[str], given: str) -> None:
    assert main.main(["normals", given, "scans/a.xyz", "out/"]) == 0
    assert names(Path("out")) == ["a.ply", "b.ply", "c[1].ply"]
    assert lines(capfd) == []


def test_a_folder_says_what_it_leaves_out(scans: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (scans / "photo.jpg").touch()
    (scans / "README").touch()
    (scans / ".hidden.ply").touch()
    (scans / "deeper.ply").mkdir()
    assert main.main(["normals", "scans", "out/"]) == 0
    said = "o3d-sofnn: WARNING: scans: left out, as no point files: (no ending) .jpg"
    assert lines(capfd) == [said]
    assert len(names(Path("out"))) == 3


def test_one_that_fails_does_not_stop_the_others(
    scans: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (scans / "aa.ply").write_text("nonsense")
    command = ["normals", "scans", "none.ply", "scans/*.e?z", "out", "--json", "report.json"]
    assert main.main(command) == main.BAD_INPUT
    said = lines(capfd)
    assert names(Path("out")) == ["a.ply", "b.ply", "c[1].ply"]
    assert [line.split(": ")[2] for line in said] == [
        "scans/aa.ply",
        "none.ply",
        "scans/*.e?z",
        "3 of 6 files failed",
    ]
    report = json.loads(Path("report.json").read_text())
    assert [Path(each["input"]).name for each in report if "points" in each] == [
        "a.xyz",
        "b.npy",
        "c[1].xyz",
    ]
    failed = [each for each in report if "error" in each]
    assert [each["input"] for each in failed] == ["scans/aa.ply", "none.ply", "scans/*.e?z"]
    assert all("not readable" in each["error"] or "ending" in each["error"] for each in failed)


def test_warnings_name_the_file(scans: Path, capfd: pytest.CaptureFixture[str]) -> None:
    np.savetxt(scans / "d.xyz", np.vstack([POINTS, [np.nan] * 3]))
    assert main.main(["normals", "scans/a.xyz", "scans/d.xyz", "out"]) == 0
    said = lines(capfd)
    assert said[0].startswith("o3d-sofnn: WARNING: scans/d.xyz: 1 of 401 points are not finite")


def test_a_folder_without_a_result_is_not_left(scans: Path) -> None:
    assert main.main(["normals", "none.ply", "out/"]) == main.BAD_INPUT
    assert not Path("out").exists()


@pytest.fixture
def no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commands, "run", lambda *_: pytest.fail("worked in vain"))


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["scans/a.xyz", "scans/b.npy", "out.ply"], "OUT: expected a folder or a name with {stem}"),
        (["scans", "out.ply"], "OUT: expected a folder or a name with {stem} for 3 files"),
        (["scans", "scans", "--output-format", "xyz"], "scans/a.xyz: expected another file than"),
        (["scans", "scans/{stem}.npy.xyz", "--json", "scans/b.npy"], "scans/b.npy: expected"),
        (["scans", "copy/a.xyz", "out/"], "out/a.ply: expected one IN for it, got scans/a.xyz and"),
        (["scans", "{stem}.ply", "--output-format", "xyz"], "--output-format: expected the ending"),
        (["scans", "out", "--output-format", "obj"], "--output-format: expected one of las laz"),
        (["scans/a.xyz", "a.ply", "--output-format", "xyz"], "--output-format: expected ply as"),
        (["scans/a.xyz", "a.ply", "--input-format", "doc"], "--input-format: expected one of asc"),
        (["copy", "out/", "--input-format", "las"], "copy: expected point files in it, got none"),
        (["-", "out.ply"], "--input-format: expected the format of the standard input"),
        (["-", "-", "out/", "--input-format", "xyz"], "IN: expected the standard input once"),
        (["scans/a.xyz", "-"], "--output-format: expected the format of the standard output"),
        (["scans", "-", "--output-format", "xyz"], "OUT: expected a folder or a name with {stem}"),
        (["scans/a.xyz", "-", "--output-format", "xyz", "--json", "-"], "--json: expected someth"),
        (
            ["scans/a.xyz", "-", "--output-format", "xyz", "--progress", "plain"],
            "--progress: expected something else",
        ),
    ],
)
def test_what_does_not_fit_is_said_before_the_work(
    scans: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    Path("copy").mkdir()
    np.savetxt("copy/a.xyz", POINTS)
    before = names(Path()), names(scans)
    assert main.main(["normals", *arguments]) == main.BAD_INPUT
    (line,) = lines(capfd)
    assert line.startswith(f"o3d-sofnn: error: {said}")
    assert (names(Path()), names(scans)) == before


def test_progress_runs_once_over_all_files(scans: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main.main(["normals", "scans", "out", "--progress", "plain"]) == 0
    out = capfd.readouterr().out.splitlines()
    percents = [int(line.split()[1]) for line in out]
    assert percents == sorted(percents)
    assert percents[-1] == 100
    assert any(line.endswith(" b.npy: read") for line in out)


def test_a_format_may_be_said_for_any_ending(scans: Path) -> None:
    os.rename("scans/a.xyz", "scan.dat")
    command = ["normals", "scan.dat", "out.ply", "--input-format", "xyz"]
    assert main.main(command) == 0
    assert np.allclose(point_files.read_points("out.ply").points, POINTS)


@pytest.mark.parametrize("ending", ["ply", "xyz", "npz", "las"])
def test_the_standard_streams(scans: Path, ending: str) -> None:
    if ending == "las":
        pytest.importorskip("laspy")
    assert main.main(["normals", "scans/a.xyz", f"file.{ending}"]) == 0
    data = Path(f"file.{ending}").read_bytes()
    formats = ["--input-format", ending, "--output-format", ending]
    command = [sys.executable, "-m", "o3d_sofnn", "normals", "-", "-", *formats]
    process = subprocess.run(command, input=data, capture_output=True, check=True)
    assert process.stderr == b""
    assert main.main(["normals", f"file.{ending}", f"again.{ending}"]) == 0
    assert process.stdout == Path(f"again.{ending}").read_bytes()


def test_messages_name_the_standard_streams(
    scans: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    stream = io.TextIOWrapper(io.BytesIO(b"1 2 3\n4 5\n"))
    monkeypatch.setattr(sys, "stdin", stream)
    command = ["normals", "-", "out.ply", "--input-format", "xyz"]
    assert main.main(command) == main.BAD_INPUT
    assert lines(capfd)[0].startswith("o3d-sofnn: error: standard input: line 2")
    monkeypatch.setattr(sys, "stdin", None)
    assert main.main(command) == main.FAILURE
    assert lines(capfd) == ["o3d-sofnn: error: standard input: closed"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_standard_output_is_a_failure(
    scans: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        command = ["reconstruct", "scans/a.xyz", "-", "--output-format", "stl"]
        assert main.main(command) == main.FAILURE
    assert lines(capfd) == ["o3d-sofnn: error: standard output: No space left on device"]


def test_the_report_names_the_streams(
    scans: Path, capfdbinary: pytest.CaptureFixture[bytes]
) -> None:
    command = ["normals", "scans/a.xyz", "-", "--output-format", "xyz", "--json", "r.json"]
    assert main.main(command) == 0
    report = json.loads(Path("r.json").read_text())
    assert (report["input"], report["output"]) == ("scans/a.xyz", "-")
    assert len(capfdbinary.readouterr().out.splitlines()) == len(POINTS)


def test_files_may_be_called_as_the_streams_are_kept(
    scans: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    os.rename("scans/a.xyz", "stdin.xyz")
    formats = ["--input-format", "xyz", "--output-format", "xyz"]
    assert main.main(["normals", "stdin.xyz", "stdout.xyz", *formats]) == 0
    assert len(Path("stdout.xyz").read_text().splitlines()) == len(POINTS)
    Path("stdin.xyz").write_text("1 2\n")
    assert main.main(["normals", "stdin.xyz", "stdout.xyz", *formats]) == main.BAD_INPUT
    assert lines(capfd)[0].startswith("o3d-sofnn: error: stdin.xyz: line 1")


def test_ctrl_c_ends_all_and_leaves_what_is_done(
    scans: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = commands.run

    def interrupted(args, job, progress):
        if job.source.name == "b.npy":
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt as error:
                raise ValueError("what a library has made of it") from error
        return run(args, job, progress)

    monkeypatch.setattr(commands, "run", interrupted)
    command = ["normals", "scans", "out", "--json", "report.json"]
    # A job in the background begins with the signal ignored, and so would the command.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert main.main(command) == main.INTERRUPTED
    finally:
        signal.signal(signal.SIGINT, before)
    assert lines(capfd) == ["o3d-sofnn: error: interrupted"]
    assert names(Path("out")) == ["a.ply"]
    assert not Path("report.json").exists()
