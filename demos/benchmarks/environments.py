"""Fresh environments: the wheels under every Python, with Open3D or not, with old and new NumPy.

For each Python there are virtual environments with NumPy 1.26 and 2, with Open3D and without, each
with the wheel for this Python and what it asks for from PyPI. There the code blocks of the README
run: all of its Python with Open3D, the blocks for arrays without, and the whole of its shell. Where
NumPy has no wheel for a Python, the row says so.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
NUMPY = {"1.26": "numpy==1.26.*", "2": "numpy>=2"}
MINORS = range(10, 20)
UTM = (500_000.0, 5_400_000.0, 300.0)
NONE = "No matching distribution found for numpy"
"""What pip says where NumPy has no wheel for this Python."""
SECONDS = 1200.0
"""What an installation, or the blocks, may take."""
HEAD = """\
| Python | NumPy | SciPy | Open3D | blocks of Python | commands | installed | run |
|---|---|---|---|---|---|---|---|"""


def inside(folder: Path) -> dict[str, str | int | None]:
    """Run the blocks of the README in this environment, in ``folder``; return what was run."""
    sys.path.insert(0, str(ROOT / "tests" / "helpers"))
    from code_blocks import blocks, commands, run_python

    _write_inputs()
    with_open3d = _version("open3d") or _version("open3d-cpu")
    found = [block for block in blocks(README) if block.reason is None]
    count = {"python": 0, "sh": 0}
    names: dict[str, object] = {"__name__": "README"}
    for block in found:
        if block.language == "python" and (with_open3d or "open3d" not in _imported(block.code)):
            run_python(block, names)
            count["python"] += 1
        elif block.language == "sh":
            for words in commands(block):
                _command(*words)
                count["sh"] += 1
    if not with_open3d and "open3d" in sys.modules:
        raise AssertionError("Open3D was loaded")
    return {
        "python": ".".join(map(str, sys.version_info[:3])),
        "numpy": _version("numpy"),
        "scipy": _version("scipy"),
        "open3d": with_open3d,
        "blocks": count["python"],
        "all_blocks": sum(block.language == "python" for block in found),
        "commands": count["sh"],
    }


def row(python: str, numpy: str, with_open3d: bool, wheels: list[Path]) -> str:
    """Make an environment, run the blocks in it, and return a row of the table."""
    number = _version_of(python)
    asked = f"| {number} | {numpy} | | {'yes' if with_open3d else 'none'} |"
    wheel = wheel_for(number, wheels)
    if wheel is None:
        return f"{asked} **none of the wheels is for this Python** | | | |"
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "environment"
        started = time.perf_counter()
        try:
            _run([python, "-m", "venv", str(place)], folder)
            program = str(place / ("Scripts" if os.name == "nt" else "bin") / "python")
            extras = "[open3d,las]" if with_open3d else "[las]"
            wanted = [f"{wheel}{extras}", NUMPY[numpy]]
            install = [program, "-m", "pip", "install", "--quiet", "--only-binary", ":all:"]
            _run([*install, *wanted], folder)
            installed = time.perf_counter()
            found = json.loads(_run([program, __file__, "--inside"], folder).splitlines()[-1])
        except (subprocess.SubprocessError, OSError) as error:
            reason = _reason(error)
            if NONE in reason:
                return f"{asked} NumPy {numpy} has no wheel for this Python | | | |"
            return f"{asked} **{reason}** | | | |"
        ended = time.perf_counter()
    return (
        f"| {found['python']} | {found['numpy']} | {found['scipy']} | {found['open3d'] or 'none'} "
        f"| {found['blocks']} of {found['all_blocks']} | {found['commands']} "
        f"| {installed - started:.0f} s | {ended - installed:.0f} s |"
    )


def wheel_for(number: str, wheels: list[Path]) -> Path | None:
    """Return the first wheel that a Python of this number installs, by the wheels' names."""
    major, minor = map(int, number.split(".")[:2])
    for wheel in wheels:
        tag, abi = wheel.stem.split("-")[2:4]
        least = (int(tag[2]), int(tag[3:]))
        if least == (major, minor) or (abi == "abi3" and least <= (major, minor)):
            return wheel
    return None


def main() -> int:
    """Print a row for each environment; 1 if there is one in which not all blocks ran."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("wheels", nargs="*", type=Path, metavar="WHEEL", help="for each Python")
    parser.add_argument(
        "--python", nargs="+", help="interpreters; without, those on the PATH: python3.10 ..."
    )
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.inside:
        with contextlib.redirect_stdout(io.StringIO()):
            found = inside(Path.cwd())
        print(json.dumps(found))
        return 0
    missing = [str(wheel) for wheel in args.wheels if not wheel.is_file()]
    if missing or not args.wheels:
        parser.error(f"WHEEL: expected files, got {', '.join(missing) or 'none'}")
    wheels = [wheel.resolve() for wheel in args.wheels]
    on_path = [shutil.which(f"python3.{minor}") for minor in MINORS]
    print(HEAD)
    failed = False
    for python in args.python or filter(None, on_path):
        for numpy in NUMPY:
            for with_open3d in (False, True):
                text = row(python, numpy, with_open3d, wheels)
                failed |= "**" in text
                print(text, flush=True)
    return int(failed)


def _write_inputs() -> None:
    """Write the files that the README names, a torus in all of them, into this folder."""
    import numpy as np

    rng = np.random.default_rng(0)
    u, v = 2.0 * np.pi * rng.random((2, 1200))
    radius = 1.0 + 0.4 * np.cos(v)
    torus = np.column_stack([radius * np.cos(u), radius * np.sin(u), 0.4 * np.sin(v)])
    scan = 0.05 * (torus + rng.normal(scale=0.01, size=torus.shape))
    np.savetxt("scan.xyz", scan)
    np.savetxt("survey.xyz", 50.0 * torus + UTM)
    for source, target in (
        ("scan.xyz", "scan.ply"),
        ("scan.xyz", "figure.ply"),
        ("scan.xyz", "room.pcd"),
        ("survey.xyz", "survey.laz"),
    ):
        _command("normals", source, target)


def _command(*words: str) -> None:
    """Run the installed program, as a shell does."""
    program = shutil.which("o3d-sofnn", path=str(Path(sys.executable).parent))
    command = [program] if program else [sys.executable, "-m", "o3d_sofnn"]
    subprocess.run([*command, *words], check=True, stdout=subprocess.DEVNULL)


def _imported(code: str) -> set[str]:
    lines = [line.split() for line in code.splitlines()]
    return {words[1] for words in lines if words[:1] in (["import"], ["from"])}


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _version_of(python: str) -> str:
    done = subprocess.run([python, "--version"], check=True, capture_output=True, text=True)
    return done.stdout.split()[-1]


def _run(command: list[str], folder: str) -> str:
    done = subprocess.run(
        command, cwd=folder, check=True, capture_output=True, text=True, timeout=SECONDS
    )
    return done.stdout


def _reason(error: Exception) -> str:
    text = error.stderr if isinstance(error, subprocess.CalledProcessError) else str(error)
    lines = [line for line in str(text).splitlines() if line.startswith("ERROR")]
    return (lines or str(text).splitlines() or [""])[-1].replace("|", "\\|")


if __name__ == "__main__":
    sys.exit(main())
