"""What calling the method from PyMeshLab costs beside the method itself.

With the native plugin where ``meshlab_sofnn.register()`` finds one, else at the Python level. The
times are those of the processor, which other work on the machine does not change.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any
from unittest import mock

import meshlab_sofnn
import numpy as np
import pymeshlab
from meshlab_sofnn import engine

FILTERS = {
    "compute_normal_for_point_clouds_sofnn": "estimate_normals",
    "generate_surface_reconstruction_sofnn": "reconstruct_surface",
}


def main() -> int:
    """Print one line for each filter and number of points; 1 when one failed, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("points", type=int, nargs="*", default=[100_000])
    parser.add_argument("--filters", nargs="+", choices=FILTERS, default=list(FILTERS))
    parser.add_argument("--quick", action="store_true", help="10,000 points")
    args = parser.parse_args()
    level = meshlab_sofnn.register()
    print("| level | filter | points | direct call, s | beside it, s | % | s per 1M points |")
    print("|---|---|---|---|---|---|---|")
    code = 0
    try:
        for name in args.filters:
            for count in [10_000] if args.quick else args.points:
                try:
                    whole, direct = _times(name, _torus(count))
                except (pymeshlab.PyMeshLabException, MemoryError) as error:  # the others go on
                    code = 1
                    print(f"| {level} | {name} | {count} | failed: {error} |", flush=True)
                    continue
                beside = whole - direct
                print(
                    f"| {level} | {name} | {count} | {direct:.2f} | {beside:.2f} "
                    f"| {100 * beside / direct:.1f} | {1e6 * beside / count:.2f} |",
                    flush=True,
                )
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return code


def _times(name: str, points: np.ndarray) -> tuple[float, float]:
    """Return the processor's seconds for a filter, and those within it for the method."""
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(points))
    inside = 0.0
    method: Callable[..., Any] = getattr(engine.pipeline, FILTERS[name])

    def timed(*args: Any, **kwargs: Any) -> Any:
        nonlocal inside
        started = time.process_time()
        result = method(*args, **kwargs)
        inside = time.process_time() - started
        return result

    with mock.patch.object(engine.pipeline, FILTERS[name], timed):
        started = time.process_time()
        ms.apply_filter(name)
        whole = time.process_time() - started
    return whole, inside


def _torus(count: int) -> np.ndarray:
    u, v = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, (2, count))
    ring = 1.0 + 0.4 * np.cos(v)
    return np.asfortranarray(np.stack([ring * np.cos(u), ring * np.sin(u), 0.4 * np.sin(v)], 1))


if __name__ == "__main__":
    sys.exit(main())
