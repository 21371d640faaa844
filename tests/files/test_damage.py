"""What files claim is checked before memory or time is spent; nothing takes the process down."""

from __future__ import annotations

import io
import os
import struct
import subprocess
import sys
import threading
import zipfile

import numpy as np
import pytest
from demo_runs import run_demo

from o3d_sofnn.files import child, point_files

resource = pytest.importorskip("resource")

MEMORY = 2**30


def refused(path, match=""):
    """Read in a process with little memory and time; return the one line that it said."""
    code = (
        "import resource, sys\n"
        f"resource.setrlimit(resource.RLIMIT_AS, ({2 * MEMORY}, {2 * MEMORY}))\n"
        "from pathlib import Path\n"
        "from o3d_sofnn.files import point_files\n"
        "try:\n    point_files.read_points(Path(sys.argv[1]))\n"
        "except ValueError as error:\n    print(error)\n"
        "else:\n    sys.exit(9)\n"
        "peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024\n"
        f"sys.exit(8 if peak > {MEMORY} else 0)\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", code, str(path)], capture_output=True, text=True, timeout=60
    )
    assert (process.returncode, process.stderr) == (0, ""), process
    assert process.stdout.count("\n") == 1
    assert process.stdout.startswith(str(path))
    assert match in process.stdout
    return process.stdout


def huge_npz(folder):
    with (
        zipfile.ZipFile(folder / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("points.npy", "w") as entry,
    ):
        np.lib.format.write_array_header_1_0(
            entry, {"descr": "<f8", "fortran_order": False, "shape": (6_250_000, 3)}
        )
        for _ in range(15):
            entry.write(bytes(10**7))
    return folder / "a.npz"


def claims(folder):
    """Yield small files that claim much."""
    ply = "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\n"
    ply += "property float z\n{}end_header\n"
    lists = "property list uint int seen\n"
    yield "ascii.ply", ply.format("ascii", 2**62, "").encode() + b"1 2 3\n"
    yield "binary.ply", ply.format("binary_little_endian", 2**62, "").encode() + bytes(24)
    yield "list.ply", ply.format("binary_little_endian", 1, lists).encode() + b"\xff" * 16
    yield "lists.ply", ply.format("binary_big_endian", 2**40, lists).encode() + bytes(16)
    yield "a.off", b"OFF\n99999999999 1 0\n1 2 3\n"
    yield "a.stl", bytes(80) + b"\xff" * 4 + bytes(50)
    header = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3)}\n"
    yield "a.npy", b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header
    nested = b"(" * 9000
    yield "b.npy", b"\x93NUMPY\1\0" + struct.pack("<H", len(nested)) + nested
    yield "c.npy", b"\x93NUMPY\2\0\xff\xff\xff\xff"
    yield "a.ptx", b"99999999\n99999999\n" + b"0 0 0\n" * 4 + b"1 0 0 0\n" * 4 + b"1 2 3 4\n"
    yield "a.pts", b"99999999999999999999\n1 2 3\n"
    yield "a.glb", b"glTF\2\0\0\0\xff\xff\xff\xff"
    yield "b.glb", b"glTF\2\0\0\0" + struct.pack("<II4s", 24, 0xFFFFFFFF, b"JSON") + b"{}  "


@pytest.mark.parametrize("name", [name for name, _ in claims(None)])
def test_more_is_claimed_than_there_is(tmp_path, name):
    (tmp_path / name).write_bytes(dict(claims(tmp_path))[name])
    with pytest.raises(ValueError, match=name):
        point_files.read_points(tmp_path / name)


def test_arrays_that_unpack_to_too_much(tmp_path):
    assert "would unpack" in refused(huge_npz(tmp_path))


def test_pickles_are_not_loaded(tmp_path):
    stream = io.BytesIO()
    np.save(stream, np.array([None, {}], dtype=object), allow_pickle=True)
    for name in ("a.npy", "a.npz"):
        if name == "a.npz":
            packed = io.BytesIO()
            with zipfile.ZipFile(packed, "w") as archive:
                archive.writestr("points.npy", stream.getvalue())
            stream = packed
        (tmp_path / name).write_bytes(stream.getvalue())
        with pytest.raises(ValueError, match="run code"):
            point_files.read_points(tmp_path / name)


@pytest.mark.parametrize("ending", sorted(point_files.CLOUD_INPUTS))
def test_pipes_and_devices_are_refused(tmp_path, ending):
    os.mkfifo(tmp_path / f"pipe{ending}")
    (tmp_path / f"zero{ending}").symlink_to("/dev/zero")
    for name in ("pipe", "zero"):
        with pytest.raises(ValueError, match="expected a regular file, got a device or pipe"):
            point_files.read_points(tmp_path / f"{name}{ending}")


def test_files_that_a_file_names_are_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    rows = "".join(f"v {i} 0 0\n" for i in range(9))
    (tmp_path / "a.obj").write_text(f"mtllib pipe\n{rows}usemtl a\nf 1 2 3\n")
    assert len(point_files.read_points(tmp_path / "a.obj").points) == 9
    contents = '{"asset": {"version": "2.0"}, "buffers": [{"uri": "pipe", "byteLength": 36}],'
    contents += '"bufferViews": [{"buffer": 0, "byteLength": 36}], "accessors": [{"bufferView": 0,'
    contents += '"componentType": 5126, "count": 3, "type": "VEC3"}],'
    contents += '"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}'
    (tmp_path / "a.gltf").write_text(contents)
    with pytest.raises(ValueError, match=r"pipe: expected a regular file"):
        point_files.read_points(tmp_path / "a.gltf")


def las(folder, ending, **changes):
    """Return a small LAS or LAZ with numbers of its header changed."""
    laspy = pytest.importorskip("laspy")
    header = laspy.LasHeader(version="1.4", point_format=6)
    data = laspy.LasData(header)
    data.x = data.y = data.z = np.arange(60.0)
    path = folder / f"a{ending}"
    data.write(str(path))
    raw = bytearray(path.read_bytes())
    places = {"offset": (96, "<I"), "vlrs": (100, "<I"), "record": (105, "<H"), "old": (107, "<I")}
    places |= {
        "scale": (131, "<d"),
        "first": (235, "<Q"),
        "evlrs": (243, "<I"),
        "count": (247, "<Q"),
    }
    for name, value in changes.items():
        struct.pack_into(places[name][1], raw, places[name][0], value)
    path.write_bytes(raw)
    return path


@pytest.mark.parametrize("ending", [".las", ".laz"])
@pytest.mark.parametrize(
    "changes",
    [
        {"vlrs": 2**32 - 1},
        {"evlrs": 2**32 - 1},
        {"evlrs": 1, "first": 2**63},
        {"offset": 2**32 - 1},
        {"offset": 0},
        {"record": 0},
        {"record": 65535},
        {"count": 2**60},
        {"count": 10**7},
        {"count": 61},
        {"scale": 0.0},
        {"scale": float("nan")},
    ],
)
def test_numbers_in_the_header_of_las(tmp_path, ending, changes, caplog, capfd):
    path = las(tmp_path, ending, **changes)
    with pytest.raises(ValueError, match=rf"a{ending}: \S") as caught:
        point_files.read_points(path)
    assert "\n" not in str(caught.value)
    assert caplog.text == ""
    assert capfd.readouterr() == ("", "")


def test_damaged_points_of_laz(tmp_path, capfd):
    whole = las(tmp_path, ".laz").read_bytes()
    rng = np.random.default_rng(0)
    outcomes = set()
    for _ in range(6):
        # The points are at the end; sizes of their layers come first.
        damaged = bytearray(whole)
        damaged[-rng.integers(1, 150)] ^= 255
        (tmp_path / "b.laz").write_bytes(damaged)
        try:
            outcomes.add(len(point_files.read_points(tmp_path / "b.laz").points))
        except ValueError as error:
            outcomes.add(str(error).split(":")[0])
    refused = str(tmp_path / "b.laz")
    assert outcomes <= {60, refused}
    assert refused in outcomes
    assert capfd.readouterr() == ("", "")


def test_a_reader_that_crashes_or_fails_is_one_error(tmp_path, monkeypatch):
    module = tmp_path / "bad_readers.py"
    module.write_text(
        "import ctypes, os, time\n"
        "def frames(path):\n"
        "    yield b'first'\n"
        "    kind = open(path).read()\n"
        "    if kind == 'crash': ctypes.string_at(0)\n"
        "    if kind == 'abort': os.abort()\n"
        "    if kind == 'wait': time.sleep(60)\n"
        "    if kind == 'memory': bytearray(2**60)\n"
        "    if kind == 'error': raise KeyError('a word')\n"
        "    if kind == 'package': raise ImportError('type: pip install it')\n"
        "    print('chatter', flush=True)\n"
        "    os.write(1, b'chatter')\n"
        "    yield b''\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(child, "_SECONDS", 3.0)
    path = tmp_path / "a.bin"
    path.write_text("fine")
    assert list(child.run("bad_readers", path)) == [b"first", b""]
    for kind, message in (
        ("crash", "its reader crashed"),
        ("abort", "its reader crashed"),
        ("wait", "took too long"),
        ("memory", "MemoryError"),
        ("error", "'a word'"),
    ):
        path.write_text(kind)
        with pytest.raises(ValueError, match=rf"a\.bin: not readable: .*{message}"):
            list(child.run("bad_readers", path))
    path.write_text("package")
    with pytest.raises(ImportError, match="type: pip install it"):
        list(child.run("bad_readers", path))


def test_threads_that_read_leave_the_streams_alone(tmp_path, capfd):
    whole = las(tmp_path, ".laz")
    (tmp_path / "a.xyz").write_text("1 2 3\n" * 5000)
    (tmp_path / "b.ply").write_bytes(b"nonsense")

    def work():
        for _ in range(3):
            assert len(point_files.read_points(whole).points) == 60
            assert len(point_files.read_points(tmp_path / "a.xyz").points) == 5000
            sys.stdout.write("upload failed\n")
            os.write(2, b"x")
            with pytest.raises(ValueError, match="not readable"):
                point_files.read_points(tmp_path / "b.ply")

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    out, err = capfd.readouterr()
    assert out == "upload failed\n" * 12
    assert err == "x" * 12


def test_the_fuzzer_of_files_finds_nothing(tmp_path):
    pytest.importorskip("laspy")
    result = run_demo(
        tmp_path, "benchmarks/fuzz/fuzz_files", "--files", 135, "--commands", 1, "--seed", 7
    )
    assert result.returncode == 0, result.stdout
    rows = [line.strip("| ").split(" | ") for line in result.stdout.splitlines()]
    total = {row[0]: row[1:] for row in rows}["all"]
    assert int(total[0]) == 135
    assert int(total[1]) > 30
    assert int(total[2]) > 30
    assert int(total[3]) == 0
