"""``make demo``: real scans in, meshes and pictures out.

The scans come with the pymeshlab wheel: a coloured chameleon, one range scan of a head (an open
sheet, trimmed), and points drawn from the bunny. Nothing is downloaded, no screen is needed.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import inputs
import pictures
from inputs import Cloud
from isolated import call
from reconstruction import Result, reconstruct

HERE = Path(__file__).parent
OVERVIEW_BYTES = 400_000
OVERVIEW = ("chameleon", "bunny")


def main() -> int:
    """Run the demo; 0 when every input succeeded, 1 when one failed, 130 after Ctrl-C."""
    args = _arguments()
    output = args.output.resolve()
    output.mkdir(parents=True, exist_ok=True)
    makers = _inputs(args.quick)
    rows: dict[str, Path] = {}
    failures = 0
    try:
        for number, (name, make) in enumerate(makers.items(), start=1):
            print(f"[{number}/{len(makers)}] {name}", flush=True)
            failures += not _run(name, make, output, args.timeout, rows)
        if set(OVERVIEW) <= set(rows):
            targets = [output / "overview.png"]
            targets += [HERE.parent / "docs" / "overview.png"] if args.docs else []
            for target in targets:
                pictures.stack(target, [rows[name] for name in OVERVIEW], max_bytes=OVERVIEW_BYTES)
                print(f"overview {target}")
    except KeyboardInterrupt:
        print(f"\ninterrupted; what was finished is in {output}", file=sys.stderr)
        return 130
    finally:
        for row in rows.values():
            row.unlink(missing_ok=True)
    print(f"meshes and pictures are in {output}")
    return 1 if failures else 0


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
    name: str, make: Callable[[], Cloud], output: Path, timeout: float, rows: dict[str, Path]
) -> bool:
    """Reconstruct and draw one input, and say so; whatever fails, the others go on."""
    try:
        cloud = make()
    except Exception as error:  # an input that cannot be read must not end the demo
        print(f"  failed to read: {error}")
        return False
    mesh_file = output / f"{name}.ply"
    outcome = call(reconstruct, cloud, mesh_file, {}, timeout=timeout)
    if outcome.error:
        print(f"  failed: {outcome.error}")
        return False
    result: Result = outcome.value
    print(
        f"  {len(cloud.points)} points -> {len(result.vertices)} vertices, "
        f"{len(result.triangles)} triangles, {'closed' if result.watertight else 'open'}, "
        f"{result.seconds:.1f} s"
    )
    print(f"  mesh     {mesh_file}")
    row = output / f".{name}-row.png"
    drawn = call(_draw, result, output / f"{name}.png", row, timeout=timeout)
    if drawn.error:
        print(f"  no picture: {drawn.error}")
        return False
    rows[name] = row
    print(f"  picture  {output / name}.png")
    return True


def _draw(result: Result, picture: Path, row: Path) -> None:
    panels = [result.points_panel(), result.normals_panel(), result.mesh_panel()]
    pictures.draw(picture, panels, result.cloud.view)
    pictures.draw(row, panels, result.cloud.view, height=300, width=420)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--output",
        type=Path,
        default=HERE / "output" / "quickstart",
        help="folder for meshes and pictures (default: %(default)s)",
    )
    parser.add_argument("--quick", action="store_true", help="fewer points, a few seconds each")
    parser.add_argument("--docs", action="store_true", help="renew docs/overview.png too")
    parser.add_argument(
        "--timeout", type=float, default=300.0, help="seconds for one input (default: %(default)g)"
    )
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
