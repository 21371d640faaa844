"""The made scenes of the benchmarks, for tests: ``from scans import scenes``."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "demos" / "benchmarks" / "accuracy"))

import scenes

__all__ = ["scenes"]
