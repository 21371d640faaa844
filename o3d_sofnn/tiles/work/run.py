"""A run over all tiles, stage by stage; what is finished is not done again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.options import Options
from o3d_sofnn.progress import ProgressCallback
from o3d_sofnn.threads import thread_count, using_threads
from o3d_sofnn.tiles.borders import Decision, decide, links_of
from o3d_sofnn.tiles.learning import run_of
from o3d_sofnn.tiles.plan import Cloud, Counts, Finder, Tile, earlier, plan
from o3d_sofnn.tiles.sides import Representatives, orient
from o3d_sofnn.tiles.work.memory import check_memory
from o3d_sofnn.tiles.work.stitch import kept_pieces, stitched, write_ply
from o3d_sofnn.tiles.work.store import (
    Manifest,
    Receipt,
    load_object,
    save_arrays,
    save_object,
)
from o3d_sofnn.tiles.work.tasks import (
    Job,
    coarse_dipoles,
    dipole_task,
    figures_of,
    finish_task,
    finished,
    learn_task,
    mesh_task,
    name_of,
    points_name,
    seam_of,
    survey_task,
    surveys_of,
    task,
)

if TYPE_CHECKING:
    from o3d_sofnn.tiles.work.engine import Engine

Array = NDArray[np.float64]


STAGES = {"read": 0.05, "survey": 0.12, "learn": 0.55, "dipoles": 0.57, "mesh": 0.93, "finish": 1.0}
"""Fraction of the work that is done after each stage."""


@dataclass(frozen=True)
class Reached:
    """A run that has come to its end.

    Attributes
    ----------
    job : Job
        Tiles and options.
    origin, edge : (3,) float64 and float
        A point x of the run is ``edge * x + origin`` in the user's coordinates.
    pieces : list of (p,) bool
        For each tile, which pieces of its mesh stay.
    report : dict
        Figures of the mesh, and what else is told.
    """

    job: Job
    origin: Array
    edge: float
    pieces: list[NDArray[np.bool_]]
    report: dict[str, Any] = field(default_factory=dict)

    def outside(self, x: Array) -> Array:
        """Convert points of the run to the user's coordinates."""
        return np.asarray(self.edge * x + self.origin)


def run_tiles(
    cloud: Cloud,
    out: Path,
    options: Options,
    engine: Engine,
    *,
    points_per_tile: int,
    identity: Mapping[str, Any],
    progress: ProgressCallback | None = None,
) -> Reached:
    """Reconstruct a surface tile by tile.

    Parameters
    ----------
    cloud : Cloud
        The points.
    out : Path
        Folder of the results; the work directory is ``work`` in it.
    options : Options
        What the user has chosen.
    engine : Engine
        Where tasks run.
    points_per_tile : int
        Largest number of points of a tile.
    identity : mapping
        What the inputs are, as JSON; a work directory serves one job.
    progress : callable, optional
        Called with the fraction done and the stage.
    """
    folder = out / "work"
    chosen = {name: _as_json(value) for name, value in asdict(options).items()}
    chosen.pop("n_threads")
    manifest = Manifest(
        folder, {"inputs": identity, "points_per_tile": points_per_tile, "options": chosen}
    )
    stages = _Stages(engine, manifest, progress)
    stages.tell(0.0, "read")
    if "plan.pickle" in manifest:
        origin, edge, tiles = load_object(folder, "plan.pickle")
    else:
        origin, edge, tiles = _planned(cloud, points_per_tile)
        manifest.add(save_object(folder, "plan.pickle", (origin, edge, tiles)))
    threads = options.n_threads
    if threads < 0 and engine.workers > 1:
        threads = max(1, thread_count() // engine.workers)
    job = Job(folder, tuple(tiles), _inside(options, origin, edge), threads)
    largest = max(tiles, key=lambda tile: tile.count)
    check_memory(largest.count, largest.number, max(engine.workers, 1))
    if "points.npz" not in manifest:
        manifest.add(_distribute(cloud, job, origin, edge))
    save_object(folder, "job.pickle", job)
    filled = [tile.number for tile in tiles if tile.count]
    every = [tile.number for tile in tiles]
    stages.run("survey", survey_task, "surveys", filled)
    with using_threads(options.n_threads):
        if "sides.pickle" not in manifest:
            sides = orient(surveys_of(job, filled), job.options)
            manifest.add(save_object(folder, "sides.pickle", sides, **_evidence(sides)))
        stages.run("learn", learn_task, "learned", filled)
        if "run.pickle" not in manifest:
            figures = [each for each in (figures_of(job, n) for n in filled) if each is not None]
            if not figures:
                raise ValueError("points define no surface: no tile has enough of them")
            run = run_of(figures, load_object(folder, "sides.pickle"), job.options)
            manifest.add(save_object(folder, "run.pickle", run))
    stages.run("dipoles", dipole_task, "dipoles", filled)
    if "coarse.pickle" not in manifest:
        manifest.add(save_object(folder, "coarse.pickle", coarse_dipoles(job)))
    stages.run("mesh", mesh_task, "meshes", every)
    if "decision.pickle" not in manifest:
        decision = _decided(job, options)
        manifest.add(save_object(folder, "decision.pickle", (decision.keep, decision.closing)))
    stages.run("finish", finish_task, "finished", every)
    closing = load_object(folder, "decision.pickle")[1]
    near = earlier(tiles, load_object(folder, "run.pickle").lattice)
    pieces, components = kept_pieces(near, lambda n: finished(job, n))
    reached = Reached(job, origin, edge, pieces)
    parts = stitched(near, lambda n: finished(job, n), pieces)
    whole = replace(write_ply(out / "mesh.ply", parts, reached.outside), components=components)
    if not whole.triangles:
        raise ValueError("points define no surface at this resolution: no data supports it")
    warnings = {text for n in filled for text in manifest[name_of("learned", n)].told["warnings"]}
    report = {
        "tiles": len(filled),
        "points": sum(tile.count for tile in tiles),
        "largest_tile": largest.count,
        **manifest["sides.pickle"].told,
        "closing": None if options.closes is True else closing.reason,
        "warnings": sorted(warnings),
        **asdict(whole),
        "watertight": whole.border_edges == 0,
    }
    return replace(reached, report=report)


class _Stages:
    """Runs the stages that have a task for each tile."""

    def __init__(
        self, engine: Engine, manifest: Manifest, progress: ProgressCallback | None
    ) -> None:
        self._engine, self._manifest, self._progress = engine, manifest, progress

    def tell(self, fraction: float, text: str) -> None:
        if self._progress is not None:
            self._progress(fraction, text)

    def run(
        self,
        stage: str,
        work: Callable[[Job, int], Receipt],
        prefix: str,
        numbers: Sequence[int],
    ) -> None:
        ends = [0.0, *STAGES.values()]
        start = ends[list(STAGES).index(stage)]
        left = [n for n in numbers if name_of(prefix, n) not in self._manifest]
        count = len(numbers) - len(left)

        def done(found: Receipt) -> None:
            nonlocal count
            self._manifest.add(found)
            count += 1
            share = count / max(len(numbers), 1)
            self.tell(start + (STAGES[stage] - start) * share, f"{stage} {count}/{len(numbers)}")

        self.tell(start, f"{stage} {count}/{len(numbers)}")
        path = self._manifest.folder / "job.pickle"
        self._engine.run(partial(task, work, path), left, done)


def _planned(cloud: Cloud, points_per_tile: int) -> tuple[Array, float, list[Tile]]:
    counts = Counts.of(cloud.chunks(), *cloud.box())
    return counts.origin, counts.edge, plan(counts, points_per_tile)


def _distribute(cloud: Cloud, job: Job, origin: Array, edge: float) -> Receipt:
    """Write the points of each tile to a file."""
    folder = job.folder / "points"
    folder.mkdir(exist_ok=True)
    for old in folder.iterdir():
        old.unlink()
    finder = Finder(job.tiles)
    for points in cloud.chunks():
        x = (points - origin) / edge
        number = finder.tiles(x)
        order = np.argsort(number, kind="stable")
        starts = np.flatnonzero(np.diff(number[order], prepend=-2))
        for rows in np.split(order, starts[1:]):
            path = job.folder / points_name(int(number[rows[0]]))
            try:
                with path.open("ab") as stream:
                    stream.write(np.ascontiguousarray(x[rows]).tobytes())
            except OSError as error:
                error.filename = str(path)
                raise
    counts = np.array([tile.count for tile in job.tiles])
    return save_arrays(job.folder, "points.npz", {"counts": counts})


def _evidence(sides: Representatives) -> dict[str, Any]:
    evidence = sides.evidence
    return {"sides": evidence.kind, "sides_figures": dict(evidence.figures)}


def _decided(job: Job, options: Options) -> Decision:
    """Decide about the closings of all tiles."""
    sums = [load_object(job.folder, f"sums/{tile.number:06d}.pickle") for tile in job.tiles]
    patches, components = [], []
    near = earlier(job.tiles, load_object(job.folder, "run.pickle").lattice)
    for tile, touched in enumerate(near):
        for other in touched:
            patch, component = links_of(seam_of(job, other), seam_of(job, tile))
            patches.append((other, tile, patch))
            components.append((other, tile, component))
    return decide(sums, patches, components, options.closes == "auto")


def _inside(options: Options, origin: Array, edge: float) -> Options:
    """Return the options in the coordinates of the run."""

    def length(value: float | None) -> float | None:
        return None if value is None else value / edge

    viewpoint = options.viewpoint
    if viewpoint is not None and viewpoint.ndim != 1:
        raise ValueError("viewpoint: expected one place for all tiles, got one for each point")
    return replace(
        options,
        radius=length(options.radius),
        voxel_size=length(options.voxel_size),
        precision=length(options.precision),
        viewpoint=None if viewpoint is None else (viewpoint - origin) / edge,
    )


def _as_json(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value
