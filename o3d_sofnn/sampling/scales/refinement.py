"""Second choice of the scale, when the sides are known (Algorithm 1, step 6)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.sampling.local_fit import Neighborhoods, fit_quadrics, sides_around
from o3d_sofnn.sampling.scales.choice import REGION, Limits, Scale, sizes_to_try, within

HEIGHTS = 4.0
"""Weight of a height difference, divided by the radius of a medium-sized fit, relative to one in
radians."""


REFERENCE = 4
"""Index of that fit among the sizes."""


def refine_scale(
    points: NDArray[np.float64],
    tree: KdTree,
    scale: Scale,
    sides: NDArray[np.float64],
    limits: Limits,
) -> Scale:
    """Choose the neighbourhood size again, from fits without the opposite side of thin parts.

    As in :func:`choose_scale`, a fit is compared with the one two sizes above, now in the normal
    and in the height of the surface: on a tube, the normals of ever larger fits agree by symmetry,
    while their heights drift. Wrong normals no longer agree above the size of a thin part, so the
    global minimum of the difference counts, not the first one.

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points.
    tree : KdTree
        Tree of `points`.
    scale : Scale
        The first choice.
    sides : (n, 3) float64
        Unit normals of the points.
    limits
        As in :func:`choose_scale`.

    Returns
    -------
    Scale
        New sizes at the same pilots; noise and spacing do not change.
    """
    sizes = sizes_to_try(len(points), limits.max_nn)
    places = scale.places
    nearest = tree.query(places, 1, np.inf)[1][:, 0]
    facing = sides_around(places, sides[nearest], sides, tree)
    fits = [
        fit_quadrics(
            tree,
            points,
            sides,
            Neighborhoods(places, facing, np.full(len(places), size), scale.noise),
        )
        for size in sizes
    ]
    normals = np.stack([fit.normals for fit in fits], axis=1)
    radius = np.stack([fit.radius for fit in fits], axis=1)
    feet = np.stack([fit.feet for fit in fits], axis=1)
    height = np.einsum("psd,pd->ps", feet - places[:, None], facing)
    unit = radius[:, min(REFERENCE, len(sizes) - 1), None]
    cosine = np.einsum("psd,psd->ps", normals[:, :-2], normals[:, 2:])
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    difference = angle + HEIGHTS * np.abs(height[:, :-2] - height[:, 2:]) / unit
    region = scale.tree.query(places, min(REGION, len(places)), np.inf)[1]
    same = np.einsum("pkd,pd->pk", facing[region], facing) > 0.0
    regional = np.einsum("pk,pks->ps", same, difference[region]) / same.sum(axis=1)[:, None]
    chosen = (regional + 0.25 * difference.mean(axis=0)).argmin(axis=1)
    chosen = np.maximum(chosen, np.searchsorted(sizes, scale.least))
    chosen = within(np.minimum(chosen, len(sizes) - 1), sizes, radius, limits)
    first = np.searchsorted(sizes, scale.n_neighbors)
    return replace(scale, n_neighbors=sizes[(first + chosen + 1) // 2])
