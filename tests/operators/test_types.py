"""What type checkers are told: arrays come back as arrays, and a number is no cloud."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("mypy")

GOOD = """
import numpy as np
from typing import Any
import o3d_sofnn

class Cloud:
    points: Any

reveal_type(o3d_sofnn.estimate_normals(np.zeros((9, 3)), viewpoint=(0, 0, 1)))
reveal_type(o3d_sofnn.estimate_normals([[0.0, 1.0, 2.0]], return_details=True))
reveal_type(o3d_sofnn.estimate_normals(Cloud()))
reveal_type(o3d_sofnn.reconstruct_surface(np.zeros((9, 3)), depth=7))
"""
BAD = """
import o3d_sofnn
o3d_sofnn.reconstruct_surface(42)
o3d_sofnn.estimate_normals([[0.0, 1.0, 2.0]], colour=3)
"""


def said(tmp_path, code):
    file = tmp_path / "snippet.py"
    file.write_text(code, encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--cache-dir", str(tmp_path / "cache"), str(file)]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=300, check=False, cwd=tmp_path
    )
    return done.stdout


def test_types_follow_what_is_given(tmp_path):
    told = said(tmp_path, GOOD + BAD)
    revealed = [line for line in told.splitlines() if "Revealed type" in line]
    assert len(revealed) == 4, told
    assert "ndarray" in revealed[0]
    assert "ndarray" in revealed[1]
    assert "NormalEstimate" in revealed[1]
    assert "Cloud" in revealed[2]
    assert revealed[3].count("ndarray") == 2
    assert told.count("error: No overload variant") == 2, told
