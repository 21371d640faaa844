"""Clouds drawn from a closed mesh, with true normals, and the options of demos that draw them."""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.geometry import mesh_properties

Array = NDArray[Any]

DENSITIES = ("uniform", "gradient", "striped", "patchy")
"""How points may be spread; the last leaves out three balls of 4 % of the diagonal."""


@dataclass(frozen=True)
class Case:
    """What is drawn: the same points for the same values, whoever asks.

    Attributes
    ----------
    file : Path
        A closed mesh.
    n : int
        Points on it.
    noise : float
        Standard deviation along each axis, in percent of the diagonal.
    outliers : float
        Points spread evenly over 1.2 x the bounding box, in percent of `n`.
    density : str
        One of ``DENSITIES``.
    """

    file: Path
    n: int = 20_000
    noise: float = 0.0
    outliers: float = 0.0
    density: str = "uniform"

    @property
    def seed(self) -> int:
        """Return a seed that depends on all of it but the folder."""
        name = (
            f"{self.file.stem}-{self.n // 1000}k-n{self.noise:g}-o{self.outliers:g}-{self.density}"
        )
        return int(hashlib.sha256(name.encode()).hexdigest()[:8], 16)


@dataclass(frozen=True)
class Cloud:
    """Points (m, 3), normals of the faces they lie on (m, 3), and False for outliers (m,)."""

    points: Array
    normals: Array
    inliers: Array

    def error(self, normals: Array) -> float:
        """Root-mean-square angle to the true normals, either side, in degrees."""
        return float(np.sqrt(np.mean(self.angles(normals) ** 2)))

    def angles(self, normals: Array) -> Array:
        """Angles between normals and the true ones at the inliers, in degrees."""
        return mesh_properties.normal_angles(normals[self.inliers], self.normals[self.inliers])


def parser(
    description: str, points: int = 20_000, noise: Sequence[float] = (0.0,)
) -> argparse.ArgumentParser:
    """Return a parser with the meshes, ``-n`` and ``--noise``.

    Parameters
    ----------
    description : str
        The demo's docstring; its first line is shown.
    points, noise
        Defaults.
    """
    found = argparse.ArgumentParser(description=description.splitlines()[0])
    found.add_argument("meshes", nargs="+", type=Path, metavar="MESH", help="closed meshes")
    found.add_argument(
        "-n", type=int, default=points, metavar="N", help="points (default: %(default)s)"
    )
    found.add_argument(
        "--noise",
        type=float,
        nargs="+",
        default=list(noise),
        metavar="P",
        help="in %% of the diagonal (default: %(default)s)",
    )
    return found


def read_closed(file: Path) -> tuple[Array, Array]:
    """Read vertices and triangles of a closed mesh, wound outwards."""
    import open3d as o3d

    mesh = o3d.io.read_triangle_mesh(str(file))
    mesh.remove_duplicated_vertices()
    mesh.remove_degenerate_triangles()
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    if mesh_properties.signed_volume(vertices, triangles) < 0.0:  # some files are wound inwards
        triangles = np.ascontiguousarray(triangles[:, ::-1])
    return vertices, triangles


def draw(case: Case) -> Cloud:
    """Draw a cloud.

    Parameters
    ----------
    case : Case
        What to draw.

    Returns
    -------
    Cloud
    """
    vertices, triangles = read_closed(case.file)
    rng = np.random.default_rng(case.seed)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corner = vertices[triangles[:, 0]]
    one, two = vertices[triangles[:, 1]] - corner, vertices[triangles[:, 2]] - corner
    cross = np.cross(one, two)
    length = np.linalg.norm(cross, axis=1)
    many = case.n * (1 if case.density == "uniform" else 6)
    face = rng.choice(len(triangles), many, p=0.5 * length / (0.5 * length).sum())
    u, v = rng.random(many), rng.random(many)
    beyond = u + v > 1.0
    u[beyond], v[beyond] = 1.0 - u[beyond], 1.0 - v[beyond]
    points = corner[face] + u[:, None] * one[face] + v[:, None] * two[face]
    normals = (cross / length[:, None])[face]
    if case.density != "uniform":
        axis = int(np.argmax(high - low))
        along = (points[:, axis] - low[axis]) / (high - low)[axis]
        if case.density == "gradient":
            share = 0.05 + along**2
        elif case.density == "striped":
            share = np.where((along * 12).astype(int) % 2 == 0, 1.0, 0.12)
        else:
            centers = points[rng.choice(many, 3, replace=False)]
            apart = np.linalg.norm(points[:, None] - centers, axis=2).min(axis=1)
            share = (apart > 0.04 * np.linalg.norm(high - low)).astype(float)
        kept = rng.choice(many, case.n, replace=False, p=share / share.sum())
        points, normals = points[kept], normals[kept]
    if case.noise:
        deviation = case.noise / 100 * float(np.linalg.norm(high - low))
        points = points + rng.normal(0.0, deviation, points.shape)
    inliers = np.ones(case.n, bool)
    if case.outliers:
        extra = int(case.outliers / 100 * case.n)
        box = 0.5 * (low + high) + (rng.random((extra, 3)) - 0.5) * (high - low) * 1.2
        points, normals = np.vstack([points, box]), np.vstack([normals, np.zeros((extra, 3))])
        inliers = np.append(inliers, np.zeros(extra, bool))
    order = rng.permutation(len(points))
    return Cloud(np.ascontiguousarray(points[order]), normals[order], inliers[order])
