"""Kinds of clouds, and the line of code for each: draws the pictures of docs/gallery."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import demo
import inputs
import pictures
from inputs import Cloud
from reconstruction import Result, reconstruct

from o3d_sofnn.compare.isolated import call

PICTURE_BYTES = 120_000


@dataclass(frozen=True)
class Case:
    """One row of the gallery.

    Attributes
    ----------
    make : callable
        (number of points) -> Cloud.
    text : str
        What is special about the cloud.
    options : dict
        Options of ``reconstruct_surface``, in addition to the ``trim`` of the cloud.
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
    "colour": Case(lambda n: inputs.with_colors(inputs.bunny(n)), "colours of the points"),
    "several": Case(inputs.several_objects, "several objects at once"),
}


def main() -> int:
    """Draw the gallery and return the exit code, see :func:`demo.work`."""
    args = demo.parser(__doc__, "gallery", 300.0, docs="docs/gallery instead").parse_args()
    output = (demo.HERE.parent / "docs" / "gallery" if args.docs else args.out).resolve()
    count = 4_000 if args.quick else 20_000
    rows: list[str] = []
    jobs = {
        name: partial(_run, name, case, count, output, args.timeout, rows)
        for name, case in CASES.items()
    }
    return demo.work(jobs, output, lambda: _table(rows))


def _run(name: str, case: Case, count: int, output: Path, timeout: float, rows: list[str]) -> None:
    """Draw a case, and append its row to the README's table."""
    cloud = case.make(count)
    result: Result = call(reconstruct, cloud, None, case.options, timeout=timeout).get()
    pictures.draw(
        output / f"{name}.png",
        [result.points_panel(), result.mesh_panel()],
        cloud.view,
        height=340,
        max_bytes=PICTURE_BYTES,
    )
    print(f"  {output / name}.png")
    options = case.options if cloud.trim is None else {"trim": cloud.trim, **case.options}
    code = ", ".join(["pcd", *(f"{key}={value}" for key, value in options.items())])
    line = f"o3d_sofnn.reconstruct_surface({code})"
    rows.append(f"| {case.text} | `{line}` | ![{name}](docs/gallery/{name}.png) |")


def _table(rows: list[str]) -> None:
    print("\n".join(["", "| input | code | points and mesh |", "| --- | --- | --- |", *rows]))


if __name__ == "__main__":
    sys.exit(main())
