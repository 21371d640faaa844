"""No triangle cuts another one: moves of vertices that make some do are taken back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import _kernels

Array = NDArray[np.float64]


Triangles = NDArray[np.int32]


def untangle(steps: Sequence[Array], triangles: Triangles, n_threads: int) -> Array:
    """Take back the moves of vertices whose triangles cut others, one step after the other.

    Parameters
    ----------
    steps : sequence of (m, 3) float64
        Places of the vertices: at first, where hardly any triangle cuts another one, and after
        each step.
    triangles : (t, 3) int32
    n_threads : int
        Threads.

    Returns
    -------
    (m, 3) float64
        Vertices as after the last step, but for those that went back.
    """
    vertices = steps[-1].copy()
    stage = np.full(len(vertices), len(steps) - 1)
    suspect = (vertices != steps[0]).any(axis=1)[triangles].any(axis=1)
    while True:
        pairs = np.asarray(_kernels.intersecting_pairs(vertices, triangles, suspect, n_threads))
        back = np.unique(triangles[pairs.ravel()])
        back = back[stage[back] > 0]
        if not len(back):
            return vertices
        for number, step in reversed(list(enumerate(steps[:-1]))):
            go = back[stage[back] == number + 1]
            vertices[go] = step[go]
            stage[go] = number
        changed = np.zeros(len(vertices), bool)
        changed[back] = True
        suspect = changed[triangles].any(axis=1)
        suspect[pairs.ravel()] = True
