"""Importing this module lets a benchmark import what the demos share."""

import sys
from pathlib import Path

DEMOS = Path(__file__).resolve().parents[2]
sys.path.append(str(DEMOS))
