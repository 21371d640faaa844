"""The memory that a tile needs, and what the machine has."""

from __future__ import annotations

import os
from pathlib import Path

BASE, PER_POINT = 400e6, 900.0
"""Bytes that a worker needs for its libraries, and for each point of a tile and its rim."""


def needed(points: int) -> float:
    """Return the bytes that a worker needs for a tile of so many points, with its rim."""
    return BASE + PER_POINT * points


def available() -> float:
    """Return the bytes that this machine can still give, or infinity if it does not say."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        found = {line.split(":")[0]: line.split()[1] for line in lines if ":" in line}
        return 1024.0 * float(found["MemAvailable"])
    except (OSError, KeyError, ValueError, IndexError):
        pass
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return float("inf")


def check_memory(points: int, tile: int, workers: int = 1) -> None:
    """Raise ``MemoryError`` if this machine cannot hold a tile of so many points."""
    wanted, there = workers * needed(points), available()
    if wanted > there:
        raise MemoryError(
            f"tile {tile} of {points} points (with its rim) needs {wanted / 1e9:.1f} GB for "
            f"{workers} workers, {there / 1e9:.1f} GB are free: choose a smaller "
            "points_per_tile, or fewer workers"
        )
