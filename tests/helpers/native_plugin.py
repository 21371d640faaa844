"""Building the native MeshLab plugin, and running code in a Python that can load it.

It needs MESHLAB_SRC, the folder ``src`` of MeshLab's sources, and a PyMeshLab of the same version:
in this Python or in the one that MESHLAB_PYTHON names. MESHLAB_BUILD names a folder to build in; it
is kept.
"""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

PLUGIN = Path(__file__).parents[2] / "filters" / "meshlab_plugin"
SOURCE = os.environ.get("MESHLAB_SRC", "")
PYTHON = os.environ.get("MESHLAB_PYTHON", sys.executable)


def folder_of_packages(folder: Path) -> Path:
    """Link the packages under test, a helper, and nothing else of this Python into a folder."""
    (folder / "layer_checks.py").symlink_to(Path(__file__).with_name("layer_checks.py"))
    for name in ("o3d_sofnn", "meshlab_sofnn"):
        spec = importlib.util.find_spec(name)
        assert spec is not None
        assert spec.origin is not None
        (folder / name).symlink_to(Path(spec.origin).parent)
    return folder


def run(packages: Path, code: str, *arguments: object, **environment: str) -> Any:
    """Run code in the Python that has the fitting PyMeshLab."""
    return subprocess.run(
        [PYTHON, "-c", code, *map(str, arguments)],
        cwd=packages,
        env={**os.environ, "PYTHONPATH": str(packages), **environment},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def pymeshlab_build(packages: Path) -> tuple[str, Path]:
    """Return the MeshLab version in PyMeshLab and the library to link."""
    found = run(packages, "import pymeshlab as p; p.print_pymeshlab_version(); print(p.__file__)")
    version = re.search(r"based on MeshLab (\S+)", found.stdout)
    if found.returncode != 0 or version is None:
        pytest.skip(f"no PyMeshLab in {PYTHON}: {found.stderr.strip()[-200:]}")
    folder = Path(found.stdout.strip().splitlines()[-1]).parent
    return version[1], folder / "lib" / "libmeshlab-common.so"


def build(packages: Path, folder: Path) -> Path:
    """Build the plugin in a folder, or skip the test with the reason why that cannot be."""
    if not SOURCE:
        pytest.skip("MESHLAB_SRC does not name the folder src of MeshLab's sources")
    if sys.platform != "linux":
        pytest.skip("the plugin's test needs Linux")
    version, library = pymeshlab_build(packages)
    headers = (Path(SOURCE).parent / "ML_VERSION").read_text().strip()
    # MeshLab compares this much: year and month, or its first digit.
    if headers[:6] != version[:6]:
        pytest.skip(f"MESHLAB_SRC is MeshLab {headers}, but PyMeshLab is built on {version}")
    options = {
        "CMAKE_BUILD_TYPE": "Release",
        "CMAKE_CXX_FLAGS": "-Wall -Wextra -Werror",
        "MESHLAB_SRC": SOURCE,
        "MESHLAB_COMMON_LIB": library,
        "MESHLAB_VERSION": version,
        "MESHLAB_SCALAR": "double",
    }
    defines = [f"-D{name}={value}" for name, value in options.items()]
    subprocess.run(["cmake", "-S", PLUGIN, "-B", folder, *defines], check=True)
    subprocess.run(["cmake", "--build", folder], check=True)
    return folder / "libfilter_sofnn.so"
