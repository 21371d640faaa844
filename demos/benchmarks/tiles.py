"""A surface from tiles beside that of one run: closed where it is, and how far from it.

Example: python tiles.py --scenes terrain room --points 200000 --tiles 4 16
"""

from __future__ import annotations

import argparse
import resource
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

from o3d_sofnn import reconstruct_surface, reconstruct_tiles
from o3d_sofnn._kernels import KdTree, nearest_triangles
from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.files import point_files
from o3d_sofnn.files.readers.ply import read_ply_mesh
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.geometry.neighbors import neighborhood_areas
from o3d_sofnn.tiles.work.store import load_object
from o3d_sofnn.tiles.work.tasks import finished


def dense_part(n, rng):
    """Return points on a wavy torus: a dense scan of a part."""
    u, v = rng.uniform(0.0, 2.0 * np.pi, (2, 2 * n))
    keep = rng.uniform(0.0, 1.4, 2 * n) < 1.0 + 0.4 * np.cos(v)
    u, v = u[keep][:n], v[keep][:n]
    tube = 0.4 + 0.02 * np.sin(9.0 * u) * np.cos(4.0 * v)
    ring = 1.0 + tube * np.cos(v)
    return np.column_stack([ring * np.cos(u), ring * np.sin(u), tube * np.sin(v)])


def terrain(n, rng):
    """Return points on hills."""
    xy = 100.0 * rng.uniform(size=(n, 2))
    x, y = xy.T
    z = 5.0 * np.sin(x / 9.0) * np.cos(y / 11.0) + 2.0 * np.sin(x / 3.1 + y / 4.0)
    return np.column_stack([xy, z])


def on_box(n, size, rng):
    """Return points on the faces of a box around the origin."""
    sides = np.asarray(size, float)
    areas = np.prod(sides) / sides
    axis = rng.choice(3, n, p=areas / areas.sum())
    points = rng.uniform(-0.5, 0.5, (n, 3))
    points[np.arange(n), axis] = 0.5 * rng.choice([-1.0, 1.0], n)
    return points * sides


def room(n, rng):
    """Return points on the walls of a room, and on a cupboard in it."""
    inside = on_box(n // 8, (1.5, 1.0, 0.8), rng) + np.array([1.0, 0.5, -0.8])
    return np.concatenate([on_box(n - n // 8, (8.0, 6.0, 3.0), rng), inside])


def city(n, rng):
    """Return points on streets and on sixteen buildings with flat roofs."""
    height = rng.uniform(6.0, 20.0, (4, 4))
    dense = n / (120.0**2 + 4.0 * 14.0 * height.sum())
    xy = 120.0 * rng.uniform(size=(int(120.0**2 * dense), 2))
    block = (xy // 30.0).astype(int)
    at = xy - 30.0 * block
    z = np.where(((at > 8.0) & (at < 22.0)).all(axis=1), height[tuple(block.T)], 0.0)
    parts = [np.column_stack([xy, z])]
    for (a, b), top in np.ndenumerate(height):
        m = int(4.0 * 14.0 * top * dense)
        side, along = rng.integers(0, 4, m), 14.0 * rng.uniform(size=m)
        edge = np.where(side < 2, 0.0, 14.0)
        x, y = np.where(side % 2, along, edge), np.where(side % 2, edge, along)
        parts.append(np.column_stack([30 * a + 8 + x, 30 * b + 8 + y, top * rng.uniform(size=m)]))
    return np.concatenate(parts)


SCENES = {"dense part": dense_part, "terrain": terrain, "room": room, "city": city}


def spacing_of(points):
    """Return the median edge of the square that one point covers."""
    some = np.ascontiguousarray(points[:: max(1, len(points) // 2000)])
    return float(np.median(np.sqrt(neighborhood_areas(some, KdTree(points, -1)))))


def kind_of(triangles):
    """Say whether a mesh is a closed or an open manifold."""
    triangles = np.ascontiguousarray(triangles, np.int32)
    good = mesh_properties.is_edge_manifold(triangles)
    good &= mesh_properties.is_vertex_manifold(triangles)
    good &= mesh_properties.is_consistently_wound(triangles)
    if not good:
        return "no manifold"
    return "open" if len(mesh_properties.boundary_edges(triangles)) else "closed"


def off_rims(x, meshes, reach):
    """Mark places, (n, 3), that are farther than that from the rims of some meshes."""
    far = np.ones(len(x), bool)
    for vertices, triangles in meshes:
        rim = np.unique(mesh_properties.boundary_edges(triangles.astype(np.int32)))
        if len(rim):
            tree = KdTree(np.ascontiguousarray(vertices[rim]), -1)
            far &= tree.query(np.ascontiguousarray(x), 1, np.inf)[0][:, 0] > reach
    return far


def row(name, points, tiles, workers, folder):
    """Return the figures of one run with tiles beside one without."""
    spacing = spacing_of(points)
    start = time.perf_counter()
    *one, details = reconstruct_surface(points, return_details=True)
    alone = time.perf_counter() - start
    point_files.write_point_cloud(folder / "points.ply", CloudArrays(points))
    start = time.perf_counter()
    found = reconstruct_tiles(
        folder / "points.ply",
        folder / "out",
        points_per_tile=max(1000, int(1.3 * len(points) / tiles)),
        workers=workers,
    )
    taken = time.perf_counter() - start
    vertices, triangles = read_ply_mesh(found.mesh)
    job = load_object(folder / "out" / "work", "job.pickle")
    origin, edge, _ = load_object(folder / "out" / "work", "plan.pickle")
    parts = [finished(job, tile.number) for tile in job.tiles]
    seam = np.concatenate([part.vertices[part.seam] for part in parts]) * edge + origin
    there = nearest_triangles(*one, np.ascontiguousarray(vertices), -1)[0]
    back = nearest_triangles(vertices, triangles.astype(np.int32), one[0], -1)[0]
    beside = np.asarray(nearest_triangles(*one, np.ascontiguousarray(seam), -1)[0]) / spacing
    # Rims follow the density of the points at the edge of the data; they are no seams.
    inside = off_rims(seam, [tuple(one), (vertices, triangles)], 3.0 * spacing)
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e6
    figures = [
        name,
        len(points),
        found.figures["tiles"],
        f"{kind_of(one[1])}, {details.quality.components}",
        f"{kind_of(triangles)}, {found.figures['components']}",
        f"{0.5 * (np.mean(there) + np.mean(back)) / spacing:.4f}",
        f"{np.quantile(beside[inside], 0.99):.3f}",
        f"{beside[inside].max():.3f}",
        f"{beside.max():.3f}",
        f"{1e6 * alone / len(points):.0f}",
        f"{1e6 * taken / len(points):.0f}",
        f"{memory:.2f}",
    ]
    shutil.rmtree(folder / "out")
    return "| " + " | ".join(map(str, figures)) + " |"


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES))
    parser.add_argument("--points", nargs="+", type=int, default=[200_000])
    parser.add_argument("--tiles", nargs="+", type=int, default=[4, 16], help="about so many")
    parser.add_argument("--noise", type=float, default=0.15, help="in spacings")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    print(
        "| scene | points | tiles | one run | tiles | Chamfer (spacings) | seam off rims, 99 % "
        "| max | at rims, max | one run, us a point | tiles, us a point | worker, GB |\n"
        + "|---" * 12
        + "|"
    )
    for name in args.scenes:
        for count in args.points:
            rng = np.random.default_rng(args.seed)
            points = SCENES[name](count, rng)
            points = points + args.noise * spacing_of(points) * rng.normal(size=points.shape)
            for tiles in args.tiles:
                with tempfile.TemporaryDirectory() as folder:
                    print(row(name, points, tiles, args.workers, Path(folder)), flush=True)


if __name__ == "__main__":
    main()
