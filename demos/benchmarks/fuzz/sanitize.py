"""Kernels and pipeline under the compiler's sanitizers: addresses, undefined behaviour, threads.

The native module is built anew for each, with GCC, into ``build/sanitize``. Then the tests of the
kernels run with it, and odd and ordinary clouds through the operators. Any report ends the run.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[3]
FOLDER = ROOT / "build" / "sanitize"
ODD = Path(__file__).with_name("fuzz_clouds.py")
KERNELS = [str(ROOT / "tests" / "native"), f"--ignore={ROOT}/tests/native/test_limits.py"]
"""Tests of the kernels; without memory the sanitizers' own allocator ends the process."""
ORDINARY = """
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np
import shapes
from o3d_sofnn import pipeline
viewpoint = np.array([9.0, 9.0, 9.0])
for threads in (1, 4):
    shape = shapes.torus(3000).noisy(0.01)
    mesh = pipeline.reconstruct_surface(shape.points, n_threads=threads)
    pipeline.reconstruct_surface(shape.points, n_threads=threads, trim="auto", viewpoint=viewpoint)
    print(len(mesh.vertices), "vertices with", threads, "threads")
"""


class Sanitizer(NamedTuple):
    """How to build for it and what to load first."""

    flags: str
    library: str
    options: dict[str, str]


SANITIZERS = {
    # CPython and numpy leave much to the end of the process: leaks cannot be told from that.
    "address": Sanitizer(
        "-fsanitize=address,undefined,float-cast-overflow -D_GLIBCXX_ASSERTIONS "
        "-fno-sanitize-recover=undefined,float-cast-overflow",
        "libasan.so",
        {"ASAN_OPTIONS": "detect_leaks=0", "UBSAN_OPTIONS": "print_stacktrace=1"},
    ),
    "thread": Sanitizer("-fsanitize=thread", "libtsan.so", {"TSAN_OPTIONS": "halt_on_error=1"}),
}


def main() -> None:
    """Build and run; the exit code is that of the first run that fails."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", choices=list(SANITIZERS), help="one of them")
    parser.add_argument("--calls", type=int, default=100, help="odd clouds, each of half a second")
    arguments = parser.parse_args()
    for name in [arguments.only] if arguments.only else SANITIZERS:
        tree, environment = build(name, SANITIZERS[name])
        only = ["-k", "threads"] if name == "thread" else []
        for command in (
            [sys.executable, "-c", ORDINARY, str(ROOT / "tests" / "helpers")],
            [sys.executable, str(ODD), "--here", "--calls", str(arguments.calls)],
            [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *KERNELS, *only],
        ):
            print(f"--- {name}: {' '.join(command[1:3])[:60]}", flush=True)
            code = subprocess.run(command, cwd=tree, env=environment, check=False).returncode
            if code:
                sys.exit(f"{name}: exit code {code}")


def build(name: str, sanitizer: Sanitizer) -> tuple[Path, dict[str, str]]:
    """Build the package for a sanitizer; return its folder and the environment to run it in."""
    folder = FOLDER / name
    shutil.rmtree(folder, ignore_errors=True)
    flags = f"{sanitizer.flags} -fno-omit-frame-pointer -g1"
    options = [
        "--quiet",
        "--no-deps",
        f"--wheel-dir={folder}",
        f"--config-settings=build-dir={folder}/cmake",
    ]
    subprocess.run(
        [sys.executable, "-m", "pip", "wheel", *options, str(ROOT)],
        env={**os.environ, "CXX": "g++", "CXXFLAGS": flags},
        check=True,
    )
    tree = folder / "tree"
    with zipfile.ZipFile(next(folder.glob("*.whl"))) as wheel:
        wheel.extractall(tree)
    libraries = [_library(sanitizer.library), _library("libstdc++.so.6")]
    return tree, {
        **os.environ,
        **sanitizer.options,
        "LD_PRELOAD": " ".join(libraries),
        "PYTHONPATH": str(tree),
        "OPENBLAS_NUM_THREADS": "1",  # threads that no sanitizer has seen the code of
    }


def _library(name: str) -> str:
    found = subprocess.run(
        ["g++", f"-print-file-name={name}"], capture_output=True, text=True, check=True
    )
    return found.stdout.strip()


if __name__ == "__main__":
    main()
