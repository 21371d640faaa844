"""One wheel serves Python 3.12 and later: its native module keeps to the stable ABI."""

from __future__ import annotations

import subprocess
import sys
from importlib.machinery import EXTENSION_SUFFIXES

import pytest

from o3d_sofnn import _kernels

pytest.importorskip("abi3audit")


def test_the_native_module_is_built_for_this_python_or_for_all_from_3_12():
    expected = ".abi3" if sys.version_info >= (3, 12) else EXTENSION_SUFFIXES[0]
    assert expected in _kernels.__file__


@pytest.mark.skipif(sys.version_info < (3, 12), reason="the stable ABI begins with Python 3.12")
def test_the_native_module_needs_no_more_than_the_stable_abi_of_python_3_12():
    audit = [sys.executable, "-m", "abi3audit", "--strict", "--assume-minimum-abi3", "3.12"]
    done = subprocess.run([*audit, _kernels.__file__], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
