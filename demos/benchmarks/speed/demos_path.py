"""Importing this module lets a benchmark import what the demos share."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2]))
