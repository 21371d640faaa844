"""What clouds are like, and the line of code that each takes: the pictures of docs/gallery."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import inputs
import pictures
from inputs import Cloud
from isolated import call
from reconstruction import Result, reconstruct

HERE = Path(__file__).parent
PICTURE_BYTES = 120_000


@dataclass(frozen=True)
class Case:
    """One row of the gallery.

    Attributes
    ----------
    make : callable
        (number of points) -> Cloud.
    text : str
        What is special about it.
    options : dict
        Of ``reconstruct_surface``, beside the ``trim`` of the cloud.
    """

    make: Callable[[int], Cloud]
    text: str
    options: dict[str, Any] = field(default_factory=dict)


CASES = {
    "clean": Case(inputs.bunny, "clean points"),
    "noisy": Case(
        lambda n: inputs.with_noise(inputs.bunny(n), 0.005), "noise, 0.5 % of the diagonal"
    ),
    "outliers": Case(lambda n: inputs.with_outliers(inputs.bunny(n), 0.02), "2 % of stray points"),
    "holes": Case(lambda n: inputs.with_holes(inputs.bunny(n), 0.06), "parts that were not seen"),
    "uneven": Case(
        lambda n: inputs.with_uneven_density(inputs.bunny(2 * n)), "density from 1 to 1/40"
    ),
    "open": Case(lambda n: inputs.face().thinned(3 * n), "a sheet with a border"),
    "colour": Case(lambda n: inputs.chameleon(), "colours of the points"),
    "several": Case(inputs.several_objects, "several objects at once"),
}


def main() -> int:
    """Draw the gallery; 0 when every case succeeded, 1 when one failed, 130 after Ctrl-C."""
    args = _arguments()
    output = (HERE.parent / "docs" / "gallery" if args.docs else args.output).resolve()
    output.mkdir(parents=True, exist_ok=True)
    count = 4_000 if args.quick else 20_000
    rows = ["| input | code | points and mesh |", "| --- | --- | --- |"]
    failures = 0
    try:
        for number, (name, case) in enumerate(CASES.items(), start=1):
            print(f"[{number}/{len(CASES)}] {name}", flush=True)
            error, code = _run(case, count, output / f"{name}.png", args.timeout)
            failures += error is not None
            print(f"  failed: {error}" if error else f"  {output / name}.png")
            if not error:
                rows.append(f"| {case.text} | `{code}` | ![{name}](docs/gallery/{name}.png) |")
    except KeyboardInterrupt:
        print(f"\ninterrupted; what was finished is in {output}", file=sys.stderr)
        return 130
    print("\n".join(["", *rows]))
    return 1 if failures else 0


def _run(case: Case, count: int, picture: Path, timeout: float) -> tuple[str | None, str]:
    """Return what went wrong (None: nothing) and the line of code."""
    try:
        cloud = case.make(count)
    except Exception as error:  # an input that cannot be read must not end the demo
        return str(error), ""
    options = dict(case.options)
    code = ", ".join(["pcd", *(f"{key}={value}" for key, value in _all(cloud, options).items())])
    outcome = call(reconstruct, cloud, None, options, timeout=timeout)
    if outcome.error is None:
        outcome = call(_draw, outcome.value, picture, timeout=timeout)
    return outcome.error, f"o3d_sofnn.reconstruct_surface({code})"


def _all(cloud: Cloud, options: dict[str, Any]) -> dict[str, Any]:
    return options if cloud.trim is None else {"trim": cloud.trim, **options}


def _draw(result: Result, picture: Path) -> None:
    panels = [result.points_panel(), result.mesh_panel()]
    pictures.draw(picture, panels, result.cloud.view, height=340, max_bytes=PICTURE_BYTES)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--output",
        type=Path,
        default=HERE / "output" / "gallery",
        help="folder for the pictures (default: %(default)s)",
    )
    parser.add_argument("--quick", action="store_true", help="fewer points")
    parser.add_argument("--docs", action="store_true", help="renew docs/gallery instead")
    parser.add_argument(
        "--timeout", type=float, default=300.0, help="seconds for one case (default: %(default)g)"
    )
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
