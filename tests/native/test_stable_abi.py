"""One wheel serves Python 3.10 and later: the native module keeps to the stable ABI."""

from __future__ import annotations

import subprocess
import sys

import pytest

from o3d_sofnn import _kernels

pytest.importorskip("abi3audit")


def test_the_native_module_needs_no_more_than_the_stable_abi_of_python_3_10():
    assert ".abi3." in _kernels.__file__
    audit = [sys.executable, "-m", "abi3audit", "--strict", "--assume-minimum-abi3", "3.10"]
    done = subprocess.run([*audit, _kernels.__file__], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
