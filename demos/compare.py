"""Compare with Open3D's and MeshLab's reconstructions: tables, pictures, one HTML report.

Raw clouds are measured against their own points; closed meshes (``--truth``) are sampled, with and
without noise, and the results measured against them. Without arguments the inputs come from the
pymeshlab wheel.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import inputs
import measure
import numpy as np
import peers
import pictures
import report
from inputs import Cloud
from isolated import call
from measure import FIGURES, Truth

from o3d_sofnn import metrics

HERE = Path(__file__).parent
NOISE = (0.0, 0.005)
"""Of points drawn from a ground truth, in parts of the diagonal."""
SAMPLES = 50_000
PICTURE_BYTES = 350_000
PATIENT = {"OMP_WAIT_POLICY": "PASSIVE"}
"""Threads of OpenMP that wait at a barrier sleep: on a busy machine they would delay each other."""
WORST = 0.01
"""Error that is drawn darkest, in parts of the diagonal."""


@dataclass(frozen=True)
class Case:
    """An input, and the truth about it when it is known."""

    cloud: Cloud
    truth: Truth | None


def main() -> int:
    """Compare; 0 when this package succeeded on every input, 1 when not, 130 after Ctrl-C."""
    args = _arguments()
    output = args.out.resolve()
    output.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    images: dict[str, Path] = {}
    note = ""
    try:
        makers = list(_makers(args))
        part = 1.0 / max(len(makers), 1)
        for number, (name, make) in enumerate(makers):
            _compare(name, make, args, output, rows, images, (number * part, part))
    except KeyboardInterrupt:
        note = "Interrupted: this is what was finished."
        print(f"\n{note}", file=sys.stderr)
    if rows:
        report.write(output / "report.html", rows, images, note)
        print(f"report {output / 'report.html'}")
    if note:
        return 130
    failed = [row for row in rows if row["method"] == "ours" and row["error"]]
    return 1 if failed or not rows else 0


def _compare(
    name: str,
    make: Callable[[], Case],
    args: argparse.Namespace,
    output: Path,
    rows: list[dict[str, Any]],
    images: dict[str, Path],
    progress: tuple[float, float],
) -> None:
    """Run all methods on one input; what fails becomes a row with its message.

    ``progress`` is the share of the work that is done, and that of this input.
    """
    try:
        case = make()
    except Exception as error:  # an input that cannot be read must not end the comparison
        rows.extend(
            {"input": name, "method": method, "error": f"not read: {error}"}
            for method in args.methods
        )
        print(f"{name}: not read: {error}", flush=True)
        return
    panels = [pictures.Panel(f"{len(case.cloud.points):,} points", case.cloud.points)]
    count = SAMPLES // 10 if args.quick else SAMPLES
    for k, method in enumerate(args.methods):
        percent = 100.0 * (progress[0] + progress[1] * k / len(args.methods))
        print(f"[{percent:3.0f} %] {name}: {method} ... ", end="", flush=True)
        row, panel = _run(case, method, count, args.timeout)
        rows.append({"input": name, **row})
        panels += [panel] if panel else []
        print(row["error"] or f"{row['seconds']:.2f} s", flush=True)
        _write_csv(output / "results.csv", rows)
    picture = output / f"{name}.png"
    drawn = call(_draw, picture, panels, case.cloud.view, timeout=args.timeout)
    if drawn.error:
        print(f"  no picture: {drawn.error}")
        return
    images[name + (", coloured by error" if case.truth else "")] = picture


def _run(
    case: Case, method: str, count: int, timeout: float
) -> tuple[dict[str, Any], pictures.Panel | None]:
    points = case.cloud.points
    outcome = call(peers.METHODS[method], points, timeout=timeout, environment=PATIENT)
    if outcome.error:
        return {"method": method, "error": outcome.error}, None
    mesh: peers.Mesh = outcome.value
    measured = call(_measure, points, mesh, case.truth, count, timeout=timeout)
    if measured.error:
        return {"method": method, "error": f"not measured: {measured.error}"}, None
    found, colors = measured.value
    row = {
        "method": method,
        "error": "",
        "seconds": outcome.seconds,
        "peak_mb": outcome.peak_mb,
        **found,
    }
    caption = f"{method}, {outcome.seconds:.1f} s"
    return row, pictures.Panel(caption, mesh.vertices, mesh.triangles, colors)


def _measure(
    points: peers.Array, mesh: peers.Mesh, truth: Truth | None, count: int
) -> tuple[dict[str, float], peers.Array | None]:
    """Return the figures and, with a truth, a colour for the error of each vertex."""
    found = measure.figures(points, mesh, truth, count)
    if truth is None:
        return found, None
    errors = measure.distances(mesh.vertices, truth.vertices, truth.triangles)[0]
    diagonal = float(np.linalg.norm(np.ptp(truth.vertices, axis=0)))
    return found, pictures.heat_colors(errors, WORST * diagonal)


def _draw(path: Path, panels: list[pictures.Panel], view: pictures.View) -> None:
    pictures.draw(path, panels, view, height=340, columns=4, max_bytes=PICTURE_BYTES)


def _makers(args: argparse.Namespace) -> Iterator[tuple[str, Callable[[], Case]]]:
    """Yield names of the inputs and what makes them, in order."""
    count = min(args.points, 4000) if args.quick else args.points
    if not args.inputs and not args.truth:
        for make in (inputs.chameleon, inputs.face):
            limit = 3000 if args.quick else 10**9
            yield make.__name__, lambda make=make, limit=limit: Case(make().thinned(limit), None)
        for name in ("bunny", "cow"):
            vertices, triangles, _ = inputs.read_model(inputs.MODELS[name][0])
            yield from _sampled(name, vertices, triangles, inputs.MODELS[name][1], count)
    for file in args.inputs:
        yield file.stem, lambda file=file: Case(_read_cloud(file), None)
    for file in args.truth:
        vertices, triangles = _read_mesh(file)
        yield from _sampled(file.stem, vertices, triangles, pictures.View(), count)


def _sampled(
    name: str, vertices: peers.Array, triangles: peers.Array, view: pictures.View, count: int
) -> Iterator[tuple[str, Callable[[], Case]]]:
    for noise in NOISE:

        def make(noise: float = noise) -> Case:
            points, normals = metrics.sample_surface(vertices, triangles, count)
            cloud = inputs.with_noise(Cloud(name, points, view=view), noise)
            return Case(cloud, Truth(vertices, triangles, normals))

        yield f"{name}_noise_{100 * noise:g}", make


def _read_cloud(file: Path) -> Cloud:
    from o3d_sofnn import adapters, io

    arrays = adapters.read_cloud(io.read_point_cloud(file))
    finite = np.isfinite(arrays.points).all(axis=1)
    return Cloud(file.stem, arrays.points[finite])


def _read_mesh(file: Path) -> tuple[peers.Array, peers.Array]:
    import open3d as o3d

    mesh = o3d.io.read_triangle_mesh(str(file)).remove_duplicated_vertices()
    vertices, triangles = np.array(mesh.vertices), np.array(mesh.triangles)
    if not metrics.is_closed(triangles):
        raise SystemExit(f"compare: --truth {file}: expected a closed mesh")
    if metrics.signed_volume(vertices, triangles) < 0:
        triangles = triangles[:, ::-1].copy()
    return vertices, triangles


def _write_csv(path: Path, rows: list[dict[str, Any]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, ["input", "method", "error", *FIGURES])
        writer.writeheader()
        writer.writerows(rows)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("inputs", nargs="*", type=Path, help="point clouds")
    parser.add_argument("--truth", nargs="+", type=Path, default=[], help="closed meshes to sample")
    parser.add_argument(
        "--methods", nargs="+", choices=list(peers.METHODS), default=list(peers.METHODS)
    )
    parser.add_argument("--points", type=int, default=20_000, help="drawn from each mesh")
    parser.add_argument(
        "--out",
        type=Path,
        default=HERE / "output" / "compare",
        help="folder for report, CSV and pictures (default: %(default)s)",
    )
    parser.add_argument("--quick", action="store_true", help="fewer points, coarser figures")
    parser.add_argument(
        "--timeout", type=float, default=180.0, help="seconds for one method (default: %(default)g)"
    )
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
