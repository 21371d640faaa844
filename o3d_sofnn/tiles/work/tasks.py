"""What a worker does: read files of the work directory, call one pure function, write one file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.implicit.units import LocalSurfaces
from o3d_sofnn.meshing.borders.closing import Closing
from o3d_sofnn.options import Options
from o3d_sofnn.rules.rule_base import RuleBase
from o3d_sofnn.threads import using_threads
from o3d_sofnn.tiles import dipoles as far
from o3d_sofnn.tiles.borders import Finished, Seam, finish, owned, settled
from o3d_sofnn.tiles.dipoles import Coarse, Dipoles, dipoles_of
from o3d_sofnn.tiles.lattice import BLOCK, GATHERED, Box
from o3d_sofnn.tiles.learning import Figures, Taught, learn_tile
from o3d_sofnn.tiles.mesh import TileMesh, mesh_tile, nothing
from o3d_sofnn.tiles.patch import Patch, Samples, joined
from o3d_sofnn.tiles.plan import Tile, earlier
from o3d_sofnn.tiles.sides import MOST, evenly
from o3d_sofnn.tiles.work.memory import check_memory
from o3d_sofnn.tiles.work.store import Receipt, load_arrays, load_object, save_arrays, save_object

Array = NDArray[np.float64]


FEW = 16
"""Smallest number of points with which a tile is learned: fewer define no surface."""


@dataclass(frozen=True)
class Job:
    """What all tasks of a run know.

    Attributes
    ----------
    folder : Path
        The work directory, which all workers see.
    tiles : tuple of Tile
        The tiles, in their order.
    options : Options
        What the user has chosen, in the coordinates of the run.
    n_threads : int
        Number of threads of one task.
    """

    folder: Path
    tiles: tuple[Tile, ...]
    options: Options
    n_threads: int

    def around(self, number: int, width: Array | float) -> list[Tile]:
        """Return the tiles with points that a tile and a rim around it touch."""
        tile = self.tiles[number]
        low, high = tile.low - width, tile.high + width
        return [each for each in self.tiles if each.count and each.touches(low, high)]

    def points(self, tile: Tile) -> Array:
        """Return the own points of a tile."""
        path = self.folder / points_name(tile.number)
        found = np.fromfile(path, np.float64)
        if len(found) != 3 * tile.count:
            raise ValueError(
                f"{path}: expected {tile.count} points, got {len(found) / 3:g}: it was changed or "
                "cut short; remove the work directory"
            )
        return found.reshape(-1, 3)

    def with_rim(self, number: int) -> Array:
        """Return the points of a tile and of its rim, tile by tile."""
        tile = self.tiles[number]
        parts = [self.points(each) for each in self.around(number, tile.rim)]
        return np.concatenate([part[tile.near(part)] for part in parts])


def points_name(number: int) -> str:
    """Return the name of the file with the points of a tile."""
    return f"points/{number:06d}.f8"


def name_of(stage: str, number: int) -> str:
    """Return the name of the file that a stage makes of a tile."""
    return f"{stage}/{number:06d}.npz"


def task(work: Callable[[Job, int], Receipt], job: Path, number: int) -> Receipt:
    """Do one task of a job, described in a file, with the number of threads of the job."""
    found: Job = load_object(job.parent, job.name)
    with using_threads(found.n_threads):
        return work(found, number)


def survey_task(job: Job, number: int) -> Receipt:
    """Choose some points of a tile."""
    share = min(1.0, MOST / sum(each.count for each in job.tiles))
    some = evenly(job.points(job.tiles[number]), share)
    return save_arrays(job.folder, name_of("surveys", number), {"points": some})


def learn_task(job: Job, number: int) -> Receipt:
    """Learn the rules of a tile."""
    tile, sides = job.tiles[number], load_object(job.folder, "sides.pickle")
    points = job.with_rim(number)
    check_memory(len(points), tile.number)
    try:
        taught = learn_tile(points, tile, sides, job.options)
    except ValueError as error:
        if len(points) >= FEW:
            raise ValueError(f"tile {number}: {error}") from error
        taught = unlearned(tile.holds(points))
    arrays = taught.patch.arrays()
    arrays |= {
        f"points.{name}": getattr(taught, name)
        for name in ("normals", "confidence", "noise", "outliers")
    }
    if taught.figures is not None:
        arrays |= {f"figures.{name}": np.asarray(x) for name, x in vars(taught.figures).items()}
    return save_arrays(
        job.folder, name_of("learned", number), arrays, warnings=list(taught.warnings)
    )


def unlearned(own: NDArray[np.bool_]) -> Taught:
    """Return what a tile with hardly any points has learned: nothing."""
    count = int(own.sum())
    zero = np.zeros(count)
    return Taught(
        no_patch(), None, np.zeros((count, 3)), zero, np.full(count, np.nan), zero == 0.0, ()
    )


def no_patch() -> Patch:
    """Return a patch without rules and samples."""
    shapes = {"centers": (0, 3), "frames": (0, 3, 3), "coefficients": (0, 6)}
    rules = {
        name: np.zeros(shapes.get(name, (0,)), np.int64 if name == "n_neighbors" else float)
        for name in RuleBase.__dataclass_fields__
    }
    empty, places = np.zeros(0), np.zeros((0, 3))
    surfaces = LocalSurfaces(np.zeros((0, 0, 4)), np.zeros(0, np.int64), empty, places, empty)
    solid = np.zeros(0, bool)
    samples = Samples(places, places, empty, empty, solid, empty, empty, empty)
    return Patch(RuleBase(**rules), surfaces, samples)


def patch_of(job: Job, number: int) -> Patch:
    """Return what a tile has learned."""
    return Patch.of(load_arrays(job.folder, name_of("learned", number)))


def figures_of(job: Job, number: int) -> Figures | None:
    """Return what a tile says about the figures of the run."""
    found = load_arrays(job.folder, name_of("learned", number))
    figures: dict[str, Any] = {k[8:]: v for k, v in found.items() if k.startswith("figures.")}
    if not figures:
        return None
    figures |= {"weight": float(figures["weight"]), "points": int(figures["points"])}
    return Figures(**figures)


def dipole_task(job: Job, number: int) -> Receipt:
    """Sum the samples of a tile in cells."""
    run, patch = load_object(job.folder, "run.pickle"), patch_of(job, number)
    samples = patch.samples
    found = dipoles_of(run.lattice, samples.places, samples.areas, samples.normals)
    return save_arrays(job.folder, name_of("dipoles", number), vars(found))


def coarse_dipoles(job: Job) -> list[Coarse]:
    """Return the dipoles of all tiles as seen from afar, tile by tile."""
    found = []
    for tile in (tile for tile in job.tiles if tile.count):
        whole = Dipoles(**load_arrays(job.folder, name_of("dipoles", tile.number)))
        found.append(Coarse.of(tile.number, whole))
    return found


def dipoles_for(job: Job, box: Box) -> list[Dipoles]:
    """Return what the blocks in a box may see of each tile: all of near ones, little of others."""
    coarse: list[Coarse] = load_object(job.folder, "coarse.pickle")
    found = []
    for each in coarse:
        dipoles = each.dipoles
        if not each.suffices(box):
            name = name_of("dipoles", each.number)
            dipoles = Dipoles(**load_arrays(job.folder, name))
        found.append(dipoles.seen_from(box))
    return found


def mesh_task(job: Job, number: int) -> Receipt:
    """Triangulate a tile."""
    run = load_object(job.folder, "run.pickle")
    tile = job.tiles[number]
    own = tile.meshed(run.lattice)
    rim, size = own.grown(GATHERED), run.lattice.size
    low, high = rim.low * size, rim.high * size
    # Samples may be beyond the tile of their points by a fraction of its rim.
    near = [t for t in job.tiles if t.count and t.touches(low - t.rim, high + t.rim)]
    patches = [patch_of(job, each.number).within(low, high) for each in near]
    patches = [each for each in patches if len(each.rules) and len(each.samples.places)]
    if patches:
        seen = far.joined(dipoles_for(job, own.grown(BLOCK)))
        mesh, sums = mesh_tile(run, own, joined(patches), seen)
    else:
        mesh, sums = nothing()
    also = [
        save_object(job.folder, f"sums/{number:06d}.pickle", sums),
        save_arrays(job.folder, name_of("seams", number), vars(Seam.of(mesh))),
    ]
    name = name_of("meshes", number)
    return save_arrays(job.folder, name, mesh.arrays(), also=[vars(each) for each in also])


def seam_of(job: Job, number: int) -> Seam:
    """Return the seam of a tile."""
    return Seam(**load_arrays(job.folder, name_of("seams", number)))


def finish_task(job: Job, number: int) -> Receipt:
    """Cut a tile's mesh where the surface ends."""
    keep, closing = load_object(job.folder, "decision.pickle")
    mesh = TileMesh(**load_arrays(job.folder, name_of("meshes", number)))
    tile = job.tiles[number]
    near = earlier(job.tiles, load_object(job.folder, "run.pickle").lattice)[number]
    seams = [settled(seam_of(job, each), keep[each]) for each in near]
    mesh = owned(settled(mesh, keep[number]), seams)
    samples = patch_of(job, number).samples.places if tile.count else np.zeros((0, 3))
    closed = isinstance(closing, Closing) and closing.closed
    found = finish(mesh, closed, samples, job.options)
    return save_arrays(
        job.folder, name_of("finished", number), vars(found), triangles=len(found.triangles)
    )


def finished(job: Job, number: int) -> Finished:
    """Return the final mesh of a tile."""
    return Finished(**load_arrays(job.folder, name_of("finished", number)))


def surveys_of(job: Job, numbers: Sequence[int]) -> list[Array]:
    """Return the points that tiles have sent."""
    return [load_arrays(job.folder, name_of("surveys", each))["points"] for each in numbers]
