"""The pictures of the guide, from generated scans: ``python docs/pictures/draw.py [NAME ...]``."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
for _folder in (ROOT / "demos" / "benchmarks" / "accuracy", ROOT / "demos", HERE):
    sys.path.insert(0, str(_folder))

import inputs  # noqa: E402
import pictures  # noqa: E402
import scenes  # noqa: E402
from arch import dental_arch  # noqa: E402
from pictures import Panel  # noqa: E402

from o3d_sofnn.compare.colors import direction_colors  # noqa: E402
from o3d_sofnn.compare.raster import View  # noqa: E402

Array = NDArray[Any]
Corner = tuple[float, float, float]

MOST_BYTES = 150_000
EVERYTHING = ((-np.inf, -np.inf, -np.inf), (np.inf, np.inf, np.inf))


@dataclass(frozen=True)
class Picture:
    """Points on the left, the mesh on the right.

    Attributes
    ----------
    cloud : callable
        Makes the cloud: points, and options of ``reconstruct_surface`` that come with them.
    view : View
        From where to look.
    within : pair of (3,) tuples of float
        Lowest and highest corner of what is drawn, to look into rooms.
    """

    cloud: Callable[[], tuple[Array, dict[str, Any]]]
    view: View
    within: tuple[Corner, Corner] = EVERYTHING


def main() -> int:
    """Draw the pictures and say what was decided about each cloud."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="*", metavar="NAME", help=" ".join([*PICTURES, "overview"]))
    for name in parser.parse_args().name or [*PICTURES, "overview"]:
        if name == "overview":
            _overview()
        else:
            points, _, mesh = _panels(name)
            view = PICTURES[name].view
            pictures.draw(
                HERE / f"{name}.png", [points, mesh], view, height=300, max_bytes=MOST_BYTES
            )
    return 0


def _overview() -> None:
    """Draw what the README begins with: a solid and an open surface, with their normals."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in ("object", "arch"):
            view = PICTURES[name].view
            rows.append(pictures.draw(Path(folder) / "row.png", _panels(name), view, height=380))
    pictures.save(HERE.parent / "overview.png", pictures.stack(rows), 2 * MOST_BYTES)


def _panels(name: str) -> list[Panel]:
    """Points, points coloured by their normals, mesh."""
    import open3d as o3d

    import o3d_sofnn

    picture = PICTURES[name]
    points, options = picture.cloud()
    pcd = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    mesh, details = o3d_sofnn.reconstruct_surface(pcd, return_details=True, **options)
    print(f"{name}: {details.normals.evidence.text}")
    print(f"  {details.closing.reason}")
    for warning in details.warnings:
        print(f"  warning: {warning}")
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    low, high = picture.within
    shown = ((low <= points) & (points <= high)).all(axis=1)
    drawn = ((low <= vertices) & (vertices <= high)).all(axis=1)[triangles].all(axis=1)
    colors = direction_colors(details.normals.normals[shown])
    kind = "closed" if details.watertight else "open"
    return [
        Panel(f"{len(points):,} points", points[shown]),
        Panel("normals by direction", points[shown], None, colors),
        Panel(f"{kind}, {len(triangles):,} triangles", vertices, triangles[drawn]),
    ]


def _scene(
    name: str, count: int, sensor: scenes.Sensor | None = None, *, stations: bool = False
) -> Callable[[], tuple[Array, dict[str, Any]]]:
    def made() -> tuple[Array, dict[str, Any]]:
        scan = scenes.make(name, count, sensor, seed=1)
        return scan.points, {"viewpoint": scan.stations} if stations else {}

    return made


LASER = scenes.Sensor(noise=0.004, mixed=0.3, dropouts=0.03)
DEPTH_CAMERA = scenes.Sensor(noise=0.0015, growth=2.0, mixed=0.5)

PICTURES = {
    "object": Picture(
        lambda: (inputs.bunny(20_000).points, {}), View((0.2, 0.25, 1.0), (0.0, 1.0, 0.0))
    ),
    "terrain": Picture(_scene("terrain", 40_000), View((0.5, -1.0, 0.75))),
    "room": Picture(
        _scene("room, two stations", 60_000, LASER),
        View((-0.6, -1.0, 1.1)),
        ((-2.95, -2.2, -1.0), (4.0, 4.0, 2.3)),
    ),
    "lidar": Picture(
        _scene("street, three stations", 60_000, LASER, stations=True),
        View((-0.3, -1.0, 1.2)),
        ((-45.0, -14.0, -5.0), (45.0, 14.0, 20.0)),
    ),
    "arch": Picture(lambda: (dental_arch(40_000), {}), View((0.0, -0.75, 0.8))),
    "depth_camera": Picture(_scene("table", 40_000, DEPTH_CAMERA), View((0.2, -1.0, 0.7))),
    "thin": Picture(lambda: (inputs.chameleon().points, {}), inputs.CHAMELEON_VIEW),
}


if __name__ == "__main__":
    sys.exit(main())
