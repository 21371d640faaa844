"""One method on one cloud, from the points to the figures: this runs in a separate process."""

from __future__ import annotations

import importlib
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from o3d_sofnn import adapters
from o3d_sofnn.compare import colors, measure, peers, raster
from o3d_sofnn.compare.cases import Case
from o3d_sofnn.compare.isolated import peak_mb
from o3d_sofnn.compare.peers import Mesh

Array = NDArray[Any]

METHODS = {
    "ours": "o3d_sofnn.compare.peers",
    "open3d_poisson": "o3d_sofnn.compare.peers",
    "open3d_ball_pivoting": "o3d_sofnn.compare.peers",
    "open3d_alpha_shape": "o3d_sofnn.compare.peers",
    "meshlab_poisson": "meshlab_sofnn.peers",
    "meshlab_ball_pivoting": "meshlab_sofnn.peers",
    "meshlab_rimls": "meshlab_sofnn.peers",
    "meshlab_apss": "meshlab_sofnn.peers",
    "meshlab_sofnn": "meshlab_sofnn.peers",
}
"""Names of the methods, and the modules that contain functions of these names."""
WORST = 0.01
"""Error that gets the darkest colour, as a fraction of the diagonal."""
DOTS = 6_000
"""Largest number of points in a pane."""
AROUND = 6
"""Number of neighbours of a scan's point within which it supports the surface."""
WIDTH, HEIGHT = 440, 380
"""Size of a picture, in pixels."""


@dataclass(frozen=True)
class Look:
    """The visible part of a result.

    Attributes
    ----------
    vertices : (m, 3) float64
        Vertices of a mesh that is simple enough for a page, or points of a cloud.
    triangles : (f, 3) int64
        None for a cloud.
    errors : (m,) float64
        Errors of the vertices, divided by ``WORST`` of the diagonal, at most 1.
    normals : (k, 3) float64, or None
        Normals at the points ``dots(case)``.
    flipped : (k,) bool, or None
        Which of them point to the wrong side; None if the truth is unknown.
    pictures : dict of str to bytes
        PNG files: "surface", "normals" (by direction), "flipped" (in red).
    """

    vertices: Array
    triangles: Array
    errors: Array
    normals: Array | None
    flipped: Array | None
    pictures: dict[str, bytes]


@dataclass(frozen=True)
class Evaluation:
    """The figures of a result (keys of ``measure.FIGURES``), and its visible part."""

    figures: dict[str, float | None]
    look: Look


def evaluate(case: Case, method: str, samples: int, triangles: int) -> Evaluation:
    """Run a method on a cloud and measure the result.

    Parameters
    ----------
    case : Case
        The cloud.
    method : str
        One of ``METHODS``.
    samples : int
        Number of points drawn from each surface for the comparison with the truth.
    triangles : int
        Largest number of triangles in the look.

    Returns
    -------
    Evaluation
        The time is that of the method only, without loading libraries.
    """
    run = getattr(_load(METHODS[method]), method)
    started = time.perf_counter()
    mesh: Mesh = run(case.points)
    seconds = time.perf_counter() - started
    memory = peak_mb()
    found = measure.figures(case.points, mesh, case.truth, samples)
    return Evaluation(
        {"seconds": seconds, "peak_mb": memory, **found}, _look(case, mesh, triangles)
    )


def before(case: Case) -> Look:
    """Return the cloud with the normals of plane fits, which are not oriented."""
    chosen = dots(case)
    points, normals = case.points[chosen], peers.plane_normals(case.points)
    frame = _frame(case)
    pale = raster.draw_points(
        frame, case.points, raster.depth_colors(frame, case.points), opaque=False
    )
    pictures = {"surface": raster.encode_png(pale), **_normal_pictures(case, normals)}
    flipped = _flipped(case, normals)
    return Look(
        points,
        np.zeros((0, 3), np.int64),
        np.zeros(len(points)),
        normals[chosen],
        None if flipped is None else flipped[chosen],
        pictures,
    )


def dots(case: Case) -> Array:
    """Return the indices of the points that panes show."""
    n = len(case.points)
    return np.sort(np.random.default_rng(0).choice(n, min(n, DOTS), replace=False))


def _load(module: str) -> Any:
    """Import what a method needs, so that importing does not count as its time."""
    adapters.import_open3d()
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != "pymeshlab":
            raise
        raise RuntimeError("PyMeshLab is not here; type: pip install pymeshlab") from error


def _look(case: Case, mesh: Mesh, triangles: int) -> Look:
    errors = surface_errors(case, mesh.vertices)
    frame = _frame(case)
    surface = raster.draw_mesh(
        frame, mesh.vertices, mesh.triangles, colors.heat_colors(errors, 1.0)
    )
    pictures = {"surface": raster.encode_png(surface)}
    simple = peers.simplify(mesh, triangles)
    nearest = cKDTree(mesh.vertices).query(simple.vertices)[1]
    chosen = dots(case)
    flipped = None
    if mesh.normals is not None:
        pictures |= _normal_pictures(case, mesh.normals)
        flipped = _flipped(case, mesh.normals)
    return Look(
        simple.vertices,
        simple.triangles,
        errors[nearest],
        None if mesh.normals is None else mesh.normals[chosen],
        None if flipped is None else flipped[chosen],
        pictures,
    )


def surface_errors(case: Case, vertices: Array) -> Array:
    """Return the distances of vertices from the truth or, without one, from the data.

    Methods place vertices between the points or on them: what counts is how much the distance of
    the nearest point exceeds its distance from its own neighbours.
    """
    if case.truth is None:
        tree = cKDTree(case.points)
        away, nearest = tree.query(vertices)
        usual = tree.query(case.points, min(AROUND + 1, len(case.points)))[0][:, -1]
        distance = np.maximum(away - usual[nearest], 0.0)
    else:
        distance = measure.distances(vertices, case.truth.vertices, case.truth.triangles)[0]
    diagonal = float(np.linalg.norm(np.ptp(case.points, axis=0)))
    return np.asarray(np.minimum(distance / (WORST * diagonal), 1.0))


def _flipped(case: Case, normals: Array) -> Array | None:
    if case.truth is None:
        return None
    return np.asarray(np.einsum("ij,ij->i", normals, case.truth.normals) <= 0)


def _normal_pictures(case: Case, normals: Array) -> dict[str, bytes]:
    frame = _frame(case)
    found = {"normals": colors.direction_colors(normals)}
    flipped = _flipped(case, normals)
    if flipped is not None:
        found["flipped"] = colors.side_colors(flipped)
    return {
        name: raster.encode_png(raster.draw_points(frame, case.points, color, opaque=True))
        for name, color in found.items()
    }


def _frame(case: Case) -> raster.Frame:
    known = case.points if case.truth is None else case.truth.vertices
    return raster.Frame.around(case.view, known, WIDTH, HEIGHT)
