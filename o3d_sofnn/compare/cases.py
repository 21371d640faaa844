"""Inputs of the comparison: clouds from files, and clouds from closed meshes (ground truth)."""

from __future__ import annotations

import hashlib
import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import adapters, validation
from o3d_sofnn.compare.measure import Truth
from o3d_sofnn.compare.raster import View
from o3d_sofnn.files import point_files, reading
from o3d_sofnn.geometry import mesh_properties

Array = NDArray[Any]

MESHES = (".ply", ".obj", ".off", ".stl", ".gltf", ".glb")
"""Extensions of files that may contain triangles."""
LONGEST = 120
"""Largest number of bytes of an input's name in its pictures' names, which may have 255 in all."""


@dataclass(frozen=True)
class Case:
    """One cloud on which every method runs.

    Attributes
    ----------
    input : str
        Name of the scan or of the model.
    points : (n, 3) float64
        Finite points.
    noise : float or None
        Standard deviation along each axis in percent of the diagonal; None if unknown.
    truth : Truth or None
        The true surface, if it is known.
    view : View
        View of the pictures.
    """

    input: str
    points: Array
    noise: float | None = None
    truth: Truth | None = None
    view: View = field(default_factory=View)

    @property
    def name(self) -> str:
        """Return a name that can be part of a file's name; long ones are cut."""
        noise = "" if self.noise is None else f"-noise-{self.noise:g}"
        return f"{_cut(self.input)}-{len(self.points)}{noise}"

    @property
    def title(self) -> str:
        """Return a human-readable name."""
        noise = "" if self.noise is None else f", {self.noise:g} % noise"
        return f"{self.input}, {len(self.points):,} points{noise}"


@dataclass(frozen=True)
class Model:
    """A closed mesh from which clouds are drawn."""

    vertices: Array
    triangles: Array


@dataclass(frozen=True)
class Source:
    """An input that is read when it is needed.

    Attributes
    ----------
    name : str
        Name of the input.
    read : callable
        () -> (n, 3) points of a scan, or a Model.
    view : View
        View of the pictures.
    """

    name: str
    read: Callable[[], Array | Model]
    view: View = field(default_factory=View)


@dataclass(frozen=True)
class Ladder:
    """How many points, and how much noise.

    Attributes
    ----------
    points : int
        Number of points drawn from a model for the comparison of noise levels.
    noise : sequence of float
        Standard deviations in percent of the diagonal.
    sizes : sequence of int
        Further numbers of points for the comparison of sizes, drawn from a model without noise, or
        selected from a scan.
    """

    points: int = 20_000
    noise: Sequence[float] = (0.0, 0.5, 1.0)
    sizes: Sequence[int] = (5_000, 50_000)


def sources(files: Sequence[Path], view: View, clouds_only: bool) -> list[Source]:
    """Return the files as inputs; names that occur twice get a number.

    Parameters
    ----------
    files : sequence of Path
        Point files, or mesh files.
    view : View
        View of all inputs.
    clouds_only : bool
        Whether closed meshes are treated as scans, too.
    """
    found: dict[str, Source] = {}
    for file in files:
        numbered = (f"{file.stem}~{number}" for number in itertools.count(2))
        name = next(name for name in itertools.chain([file.stem], numbered) if name not in found)
        found[name] = Source(name, partial(read, file, clouds_only), view)
    return list(found.values())


def read(file: Path, clouds_only: bool = False) -> Array | Model:
    """Read a closed mesh as a model, everything else as the finite points of a scan.

    Raises
    ------
    OSError, ValueError
        As in :func:`read_points`.
    """
    points = read_points(file)
    if clouds_only or file.suffix.lower() not in MESHES:
        return points
    vertices, triangles = reading.read_triangles(file)
    if not mesh_properties.is_closed(triangles):
        return points
    if mesh_properties.signed_volume(vertices, triangles) < 0:
        triangles = triangles[:, ::-1].copy()
    return Model(vertices, triangles)


def read_points(file: Path) -> Array:
    """Return the finite points, (n, 3), of a cloud, or the vertices of a mesh.

    Raises
    ------
    OSError, ValueError
        As in :func:`o3d_sofnn.files.point_files.read_point_cloud`, or there are fewer than four
        finite points.
    """
    cloud = adapters.read_cloud(point_files.read_point_cloud(file)).points
    points = cloud[validation.finite_rows(cloud)]
    if len(points) < validation.MIN_POINTS:
        raise ValueError(
            f"{file}: expected at least {validation.MIN_POINTS} finite points, got {len(points)}"
        )
    return points


def cases(source: Source, ladder: Ladder) -> Iterator[Case]:
    """Yield the clouds of an input; they are the same every time."""
    found = source.read()
    if not isinstance(found, Model):
        yield Case(source.name, found, view=source.view)
        for size in sorted(set(ladder.sizes)):
            if size < len(found):
                keep = np.random.default_rng(0).choice(len(found), size, replace=False)
                yield Case(source.name, found[np.sort(keep)], view=source.view)
        return
    for noise in sorted(set(ladder.noise)):
        yield _drawn(source, found, ladder.points, noise)
    for size in sorted(set(ladder.sizes) - {ladder.points}):
        yield _drawn(source, found, size, 0.0)


def count(source: Source, ladder: Ladder) -> int:
    """Return the largest number of clouds that an input can have, before it is read."""
    return max(len(set(ladder.noise)) + len(set(ladder.sizes) - {ladder.points}), 1)


def _cut(name: str) -> str:
    data = os.fsencode(name)
    if len(data) <= LONGEST:
        return name
    return f"{data[:LONGEST].decode(errors='ignore')}~{hashlib.sha256(data).hexdigest()[:8]}"


def _drawn(source: Source, model: Model, count: int, noise: float) -> Case:
    points, normals = mesh_properties.sample_surface(model.vertices, model.triangles, count)
    sigma = 0.01 * noise * float(np.linalg.norm(np.ptp(model.vertices, axis=0)))
    points = points + np.random.default_rng(1).normal(0.0, 1.0, points.shape) * sigma
    return Case(
        source.name, points, noise, Truth(model.vertices, model.triangles, normals), source.view
    )
