"""What is compared: clouds from files, and clouds from closed meshes, whose truth is known."""

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
"""Endings of files that may hold triangles."""
LONGEST = 120
"""Bytes of an input's name in the names of its pictures; these may have 255 with all the rest."""


@dataclass(frozen=True)
class Case:
    """One cloud on which every method runs.

    Attributes
    ----------
    input : str
        Name of the scan or of the model.
    points : (n, 3) float64
        Finite.
    noise : float or None
        Standard deviation along each axis in percent of the diagonal; None when it is not known.
    truth : Truth or None
        The true surface, when it is known.
    view : View
        From where pictures show it.
    """

    input: str
    points: Array
    noise: float | None = None
    truth: Truth | None = None
    view: View = field(default_factory=View)

    @property
    def name(self) -> str:
        """Return a name that can be part of a file's name: long ones are cut."""
        noise = "" if self.noise is None else f"-noise-{self.noise:g}"
        return f"{_cut(self.input)}-{len(self.points)}{noise}"

    @property
    def title(self) -> str:
        """Return a name for people."""
        noise = "" if self.noise is None else f", {self.noise:g} % noise"
        return f"{self.input}, {len(self.points):,} points{noise}"


@dataclass(frozen=True)
class Model:
    """A closed mesh from which clouds are drawn."""

    vertices: Array
    triangles: Array


@dataclass(frozen=True)
class Source:
    """An input that is read when its turn comes.

    Attributes
    ----------
    name : str
        Of the input.
    read : callable
        () -> (n, 3) points of a scan, or a Model.
    view : View
        From where pictures show it.
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
        Drawn from a model for the comparison over noise.
    noise : sequence of float
        Standard deviations in percent of the diagonal.
    sizes : sequence of int
        Further numbers of points for the comparison over size: drawn from a model without noise,
        or kept of a scan.
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
        For all of them.
    clouds_only : bool
        Whether also the vertices of a closed mesh are taken for a scan.
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
        As of :func:`read_points`.
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
        As of :func:`o3d_sofnn.files.point_files.read_point_cloud`; also where there are fewer than
        four.
    """
    cloud = adapters.read_cloud(point_files.read_point_cloud(file)).points
    points = cloud[validation.finite_rows(cloud)]
    if len(points) < validation.MIN_POINTS:
        raise ValueError(
            f"{file}: expected at least {validation.MIN_POINTS} finite points, got {len(points)}"
        )
    return points


def cases(source: Source, ladder: Ladder) -> Iterator[Case]:
    """Yield the clouds of an input: the same numbers every time."""
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
    """Return the most clouds that an input can have, before it is read."""
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
