"""Real scans in, meshes and pictures out.

The scans come with the pymeshlab wheel: a coloured chameleon, one range scan of a head (an open
sheet, trimmed), and points drawn from the bunny. Nothing is downloaded, and no screen is needed.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import demo
import inputs
import pictures
from inputs import Cloud
from reconstruction import Result, reconstruct

from o3d_sofnn.compare.isolated import call

OVERVIEW_BYTES = 400_000
OVERVIEW = ("chameleon", "bunny")


def main() -> int:
    """Run the demo and return its exit code, see :func:`demo.work`."""
    args = demo.parser(__doc__, "quickstart", 300.0).parse_args()
    output = args.out.resolve()
    rows: dict[str, Any] = {}
    jobs = {
        name: partial(_run, name, make, output, args.timeout, rows)
        for name, make in _inputs(args.quick).items()
    }
    return demo.work(jobs, output, lambda: _overview(rows, output))


def _inputs(quick: bool) -> dict[str, Callable[[], Cloud]]:
    if quick:
        return {
            "chameleon": inputs.chameleon,
            "face": lambda: inputs.face().thinned(8_000),
            "bunny": lambda: inputs.bunny(5_000),
        }
    return {
        "chameleon": inputs.chameleon,
        "face": inputs.face,
        "bunny": lambda: inputs.bunny(30_000),
    }


def _run(
    name: str, make: Callable[[], Cloud], output: Path, timeout: float, rows: dict[str, Any]
) -> None:
    cloud = make()
    mesh_file = output / f"{name}.ply"
    result: Result = call(reconstruct, cloud, mesh_file, {}, timeout=timeout).get()
    print(
        f"  {len(cloud.points)} points -> {len(result.vertices)} vertices, "
        f"{len(result.triangles)} triangles, {'closed' if result.watertight else 'open'}, "
        f"{result.seconds:.1f} s"
    )
    print(f"  mesh     {mesh_file}")
    panels = [result.points_panel(), result.normals_panel(), result.mesh_panel()]
    rows[name] = pictures.draw(output / f"{name}.png", panels, cloud.view, height=380)
    print(f"  picture  {output / name}.png")


def _overview(rows: dict[str, Any], output: Path) -> None:
    if set(OVERVIEW) <= set(rows):
        whole = pictures.stack([rows[name] for name in OVERVIEW])
        pictures.save(output / "overview.png", whole, OVERVIEW_BYTES)
        print(f"overview {output / 'overview.png'}")


if __name__ == "__main__":
    sys.exit(main())
