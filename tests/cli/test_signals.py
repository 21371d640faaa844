"""Signals: whenever they come, no half file stays, and the exit code says which it was."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapes

from o3d_sofnn.cli import commands, main
from o3d_sofnn.files import outputs, point_files
from o3d_sofnn.files.writers import formats

pytest.importorskip("open3d")

ALL = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture(autouse=True)
def usual_handlers():
    """Handle signals as a program in the foreground does; a test run may ignore them."""
    usual = dict.fromkeys(ALL, signal.SIG_DFL) | {signal.SIGINT: signal.default_int_handler}
    before = {number: signal.signal(number, handler) for number, handler in usual.items()}
    yield
    after = {number: signal.signal(number, handler) for number, handler in before.items()}
    assert after == usual  # the command has put them back


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    np.savetxt(tmp_path / "scan.xyz", shapes.torus(400).points)
    return tmp_path / "scan.xyz"


@pytest.mark.parametrize("number", ALL)
def test_in_the_midst_of_writing(tmp_path, scan, capfd, monkeypatch, number):
    output = tmp_path / "out.ply"
    output.write_bytes(b"old")

    def write(stream, cloud):
        stream.write(b"half")
        stream.flush()
        assert len(list(tmp_path.iterdir())) == 3
        signal.raise_signal(number)
        pytest.fail("went on")

    monkeypatch.setitem(formats.CLOUD_WRITERS, ".ply", write)
    assert main.main(["normals", str(scan), str(output)]) == 128 + number
    assert capfd.readouterr() == ("", "o3d-sofnn: error: interrupted\n")
    assert sorted(tmp_path.iterdir()) == [output, scan]
    assert output.read_bytes() == b"old"


@pytest.mark.parametrize("number", ALL)
def test_what_libraries_make_of_it_does_not_count(tmp_path, scan, capfd, monkeypatch, number):
    def load(command):
        signal.raise_signal(number)
        raise ImportError("numpy failed to import")

    monkeypatch.setattr(commands, "load", load)
    arguments = ["normals", str(scan), str(tmp_path / "out.ply")]
    assert main.main(arguments) == 128 + number
    assert capfd.readouterr().err == "o3d-sofnn: error: interrupted\n"

    def swallow(args, job, progress):
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt:
            progress(0.5, "as if nothing had been")
        pytest.fail("went on")

    monkeypatch.setattr(commands, "load", lambda command: None)
    monkeypatch.setattr(commands, "run", swallow)
    assert main.main(arguments) == 128 + number


def test_while_libraries_load_signals_wait(tmp_path, scan, monkeypatch):
    done = []

    def load(command):
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)  # the second one changes nothing
        done.append(command)

    monkeypatch.setattr(commands, "load", load)
    monkeypatch.setattr(commands, "run", lambda *_: pytest.fail("went on"))
    assert main.main(["normals", str(scan), str(tmp_path / "out.ply")]) == 128 + signal.SIGTERM
    assert done == ["normals"]


def test_the_second_signal_finds_nobody(tmp_path, scan, capfd, monkeypatch):
    """Neither while the first one is tidied up after, nor while the interpreter ends."""

    def twice(args, job, progress):
        try:
            signal.raise_signal(signal.SIGHUP)
        finally:
            signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(commands, "load", lambda command: None)
    monkeypatch.setattr(commands, "run", twice)
    arguments = ["normals", str(scan), str(tmp_path / "out.ply")]
    monkeypatch.setattr(sys, "argv", ["o3d-sofnn", *arguments])
    usual = [signal.getsignal(number) for number in ALL]
    assert main.main() == 128 + signal.SIGHUP
    signal.raise_signal(signal.SIGTERM)
    for number, handler in zip(ALL, usual, strict=True):
        signal.signal(number, handler)
    assert main.main(arguments) == 128 + signal.SIGHUP
    assert capfd.readouterr().err == 2 * "o3d-sofnn: error: interrupted\n"


def test_ignored_signals_stay_ignored(tmp_path, scan, monkeypatch):
    """As with nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    load = commands.load

    def hang_up(command):
        signal.raise_signal(signal.SIGHUP)
        load(command)

    monkeypatch.setattr(commands, "load", hang_up)
    assert main.main(["normals", str(scan), str(tmp_path / "out.ply")]) == 0
    assert signal.signal(signal.SIGHUP, signal.SIG_DFL) is signal.SIG_IGN


def started(command: str, scan: Path, output: Path) -> subprocess.Popen:
    return subprocess.Popen(
        [sys.executable, "-m", "o3d_sofnn", command, scan, output, "--progress", "plain"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=output.parent,
        # A test run in the background of a shell ignores SIGINT, and its children inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )


def test_ctrl_c_while_numpy_is_imported(tmp_path, scan):
    with started("normals", scan, tmp_path / "out.ply") as process:
        assert process.stdout.readline() == "PROGRESS 0 load\n"
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (main.INTERRUPTED, "o3d-sofnn: error: interrupted\n")
    assert list(tmp_path.iterdir()) == [scan]


@pytest.mark.parametrize("command", ["normals", "reconstruct"])
def test_ctrl_c_during_the_work(tmp_path, command):
    np.savetxt(tmp_path / "scan.xyz", shapes.torus(50_000).points)
    output = tmp_path / "out.ply"
    output.write_bytes(b"old")
    before = sorted(tmp_path.iterdir())
    with started(command, tmp_path / "scan.xyz", output) as process:
        for line in process.stdout:
            # The first report from within the work, after loading and reading.
            if int(line.split()[1]) >= 5:
                break
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (main.INTERRUPTED, "o3d-sofnn: error: interrupted\n")
    assert sorted(tmp_path.iterdir()) == before
    assert output.read_bytes() == b"old"


def test_the_exit_code_is_ours_wherever_the_signal_came(tmp_path):
    """``python -m`` kills itself by SIGINT after code from a text was interrupted."""
    (tmp_path / "program.py").write_text(
        "import sys\n"
        "from o3d_sofnn.cli import commands, main\n"
        "commands.load = lambda command: None\n"
        "source = 'import signal; signal.raise_signal(signal.SIGTERM)'\n"
        "commands.run = lambda args, job, progress: exec(source)\n"
        "sys.exit(main.main())\n"
    )
    process = subprocess.run(
        [sys.executable, "-m", "program", "normals", "scan.ply", "out.ply"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert process.stderr == "o3d-sofnn: error: interrupted\n"
    assert process.returncode == 128 + signal.SIGTERM


class InterruptedAt:
    """Raise KeyboardInterrupt before the n-th instruction of the module that writes files."""

    def __init__(self, n: int) -> None:
        self.left = n

    def __enter__(self) -> None:
        self.before = sys.gettrace()
        sys.settrace(self.trace)

    def __exit__(self, *_: object) -> None:
        sys.settrace(self.before)

    def trace(self, frame, event, argument):
        if frame.f_code.co_filename != outputs.__file__:
            return None
        frame.f_trace_opcodes = True
        if event == "opcode":
            self.left -= 1
            if self.left == 0:
                raise KeyboardInterrupt
        return self.trace


def write(path: Path) -> None:
    point_files.check_output(path, ())
    with point_files.open_atomic(path) as stream:
        stream.write(b"new")


def test_ctrl_c_before_any_instruction_leaves_no_half_file(tmp_path):
    target = tmp_path / "out.bin"
    contents = set()
    for n in range(1, 10_000):
        target.write_bytes(b"old")
        try:
            with InterruptedAt(n):
                write(target)
        except KeyboardInterrupt:
            contents.add(target.read_bytes())
            assert list(tmp_path.iterdir()) == [target], n
        else:
            break
    assert n > 100
    assert contents == {b"old", b"new"}
    assert target.read_bytes() == b"new"
