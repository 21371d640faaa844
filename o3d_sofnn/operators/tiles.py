"""The third operator: a mesh of clouds larger than one machine, tile by tile."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from numpy.typing import ArrayLike

from o3d_sofnn import validation
from o3d_sofnn.files.outputs import open_atomic
from o3d_sofnn.operators.common import progress_of, warn
from o3d_sofnn.options import Options
from o3d_sofnn.progress import ProgressCallback
from o3d_sofnn.tiles.work import chunks
from o3d_sofnn.tiles.work.engine import engine_of

POINTS = 2_000_000


@dataclass(frozen=True)
class TilesReport:
    """What :func:`reconstruct_tiles` has made.

    Attributes
    ----------
    mesh : pathlib.Path
        The mesh of all tiles.
    figures : dict
        The contents of ``report.json``.
    """

    mesh: Path
    figures: dict[str, Any]


def reconstruct_tiles(
    inputs: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    points_per_tile: int = POINTS,
    workers: int | None = None,
    scheduler: str | None = None,
    executor: Executor | None = None,
    normals: bool = False,
    format: Literal["ply", "glb"] | None = None,
    depth: int | None = None,
    voxel_size: float | None = None,
    viewpoint: ArrayLike | None = None,
    towards: ArrayLike | None = None,
    closed: bool | Literal["auto"] = "auto",
    trim: float | Literal["auto"] | None = None,
    precision: float | None = None,
    max_nn: int | None = None,
    radius: float | None = None,
    n_threads: int = -1,
    print_progress: bool | ProgressCallback = False,
) -> TilesReport:
    """Reconstruct one triangle mesh from files of any size, tile by tile.

    Neighbouring tiles have the same vertices along their seams, so that the mesh is closed where a
    run without tiles would close it. The result has the same bits for any number of workers and any
    order of their work. A run that was interrupted goes on from the tiles that are finished.

    Parameters
    ----------
    inputs : path-like or sequence of path-like
        LAS, LAZ, COPC, PLY, PCD or E57 files, folders of them, or wildcards; they may overlap. LAS,
        LAZ, COPC and binary PLY are read in parts.
    out : path-like
        Folder for ``mesh.ply`` (coordinates in double precision, normals, confidence) and
        ``report.json``; ``work`` in it is the work directory, which may be removed afterwards. With
        a scheduler, all workers must see it under the same name.
    points_per_tile : int, default 2000000
        Largest number of points of a tile (at least 1000): a worker needs about 0.9 kB for each.
    workers : int, optional
        Number of processes on this machine, which start afresh: a script that asks for them has
        ``if __name__ == "__main__":`` around its calls. None works in this process.
    scheduler : str, optional
        Address of a Dask scheduler, such as "tcp://host:8786". Needs ``dask[distributed]``.
    executor : concurrent.futures.Executor, optional
        Any other engine; it is not shut down. At most one of ``workers``, ``scheduler``,
        ``executor``.
    normals : bool, default False
        Also write the points with their normals to ``normals/*.laz``, one file a tile.
    format : {"ply", "glb"}, optional
        Also write one mesh a tile to ``tiles/``; neighbours share their border vertices exactly.
    depth, voxel_size, viewpoint, towards, closed, trim, precision, max_nn, radius
        As in :func:`reconstruct_surface`; `viewpoint` is one place.
    n_threads : int, default -1
        Number of threads of each worker; -1 divides the cores among the workers.
    print_progress : bool or callable, default False
        True draws a bar over the tiles, with the time left where tqdm is installed; a callable gets
        (fraction, text).

    Returns
    -------
    TilesReport

    Raises
    ------
    ValueError
        An input cannot be read (the message names the file) or an option is out of range; ``out``
        has the work directory of another job.
    MemoryError
        This machine cannot hold a tile of that many points.
    OSError
        The disk is full or the folder not writable; the message names the file.
    """
    started = time.perf_counter()
    validation.check_exclusive(workers=workers, scheduler=scheduler)
    validation.check_exclusive(workers=workers, executor=executor)
    validation.check_exclusive(scheduler=scheduler, executor=executor)
    validation.check_integer(workers, "workers", 1)
    from o3d_sofnn.tiles.work import results, run  # the whole method: only where it is used

    validation.check_integer(points_per_tile, "points_per_tile", 1000)
    normals = validation.check_flag(normals, "normals")
    if format is not None and format not in results.FORMATS:
        raise ValueError(f"format: expected ply or glb, got {format}")
    options = Options.checked(
        1,
        max_nn=max_nn,
        radius=radius,
        viewpoint=viewpoint,
        towards=towards,
        n_threads=n_threads,
        depth=depth,
        voxel_size=voxel_size,
        closed=closed,
        trim=trim,
        precision=precision,
    )
    names = [inputs] if isinstance(inputs, (str, os.PathLike)) else list(inputs)
    files = chunks.Files(chunks.found(names))
    folder = results.check_folder(out).resolve()
    with (
        engine_of(workers, scheduler, executor) as engine,
        progress_of(print_progress) as progress,
    ):
        reached = run.run_tiles(
            files,
            folder,
            options,
            engine,
            points_per_tile=points_per_tile,
            identity={"files": files.identity},
            progress=progress,
        )
        crs = files.common_crs()
        report = {"inputs": [str(path) for path in files.paths], **reached.report}
        report |= {"left_out": files.left_out, "crs": crs}
        if normals:
            report["normals"] = results.write_normals(reached, folder / "normals", crs)
        if format is not None:
            report["meshes"] = results.write_meshes(reached, folder / "tiles", format, crs)
        report["seconds"] = round(time.perf_counter() - started, 3)
        with open_atomic(folder / "report.json") as stream:
            stream.write((json.dumps(report, indent=2) + "\n").encode())
        if progress is not None:
            progress(1.0, "done")
    warn(*report["warnings"])
    return TilesReport(folder / "mesh.ply", report)
