"""Demos as programs of their own."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

DEMOS = Path(__file__).parents[2] / "demos"

Run = Callable[..., subprocess.CompletedProcess[str]]
"""Takes the name of a demo and its arguments."""


def run_demo(folder: Path, name: str, *arguments: Any) -> subprocess.CompletedProcess[str]:
    """Run a demo in a folder of its own and return what it said."""
    return subprocess.run(
        [sys.executable, DEMOS / f"{name}.py", *map(str, arguments)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
