"""The first thing that is asked of a wheel: is it whole, and does a sphere become a sphere."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

import o3d_sofnn

N = 2000


def main() -> None:
    """Reconstruct a sphere, and start the program."""
    points = np.random.default_rng(0).normal(size=(N, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    normals = o3d_sofnn.estimate_normals(points)
    assert np.einsum("ij,ij->i", normals, points).min() > 0.9
    vertices, triangles = o3d_sofnn.reconstruct_surface(points)
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    uses = np.unique(edges, axis=0, return_counts=True)[1]
    assert (uses == 2).all()
    assert len(vertices) - len(uses) + len(triangles) == 2
    assert np.abs(np.linalg.norm(vertices, axis=1) - 1).max() < 0.02
    subprocess.run([sys.executable, "-m", "o3d_sofnn", "--version"], check=True)


if __name__ == "__main__":
    main()
