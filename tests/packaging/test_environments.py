"""What fresh environments are asked for: here in the environment of the tests."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from code_blocks import blocks

ROOT = Path(__file__).parents[2]
PROGRAM = ROOT / "demos" / "benchmarks" / "environments.py"


def test_the_sphere_that_is_asked_of_every_wheel() -> None:
    sphere = Path(__file__).with_name("sphere.py")
    done = subprocess.run([sys.executable, sphere], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_all_blocks_of_the_readme_run_inside(tmp_path: Path) -> None:
    pytest.importorskip("open3d")
    pytest.importorskip("laspy")
    done = subprocess.run(
        [sys.executable, PROGRAM, "--inside"], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    wanted = [b for b in blocks(ROOT / "README.md") if b.language == "python" and not b.reason]
    assert found["blocks"] == found["all_blocks"] == len(wanted)
    assert found["commands"] > 10


def test_without_a_wheel_the_message_says_so() -> None:
    done = subprocess.run([sys.executable, PROGRAM, "no.whl"], capture_output=True, text=True)
    assert done.returncode == 2
    assert "expected files, got no.whl" in done.stderr


def test_each_python_gets_its_wheel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(PROGRAM.parent))
    from environments import wheel_for

    names = ("cp310-cp310", "cp311-cp311", "cp312-abi3")
    wheels = [Path(f"o3d_sofnn-0.1.0-{name}-linux_x86_64.whl") for name in names]
    found = [wheel_for(number, wheels) for number in ("3.10.13", "3.11.7", "3.12.1", "3.14.0")]
    assert found == [wheels[0], wheels[1], wheels[2], wheels[2]]
    assert wheel_for("3.9.18", wheels) is None
    assert wheel_for("3.11.7", wheels[::2]) is None
