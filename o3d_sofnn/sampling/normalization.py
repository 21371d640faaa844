"""The unit of a cloud: its box becomes the unit cube; no point far away or dense spot decides it.

All that follows is computed in that unit, some of it in single precision: a point far from all
others would leave no digits for them, and closer together than rounding points have no surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.geometry.frame import Frame
from o3d_sofnn.geometry.vectors import affine_rank, bounds
from o3d_sofnn.sampling.cells import sort_unique
from o3d_sofnn.validation import MIN_POINTS, check_magnitude, finite_rows

FAR = 1000.0
"""Size of the box of all points, over that without the outermost ones, from which on those are left
out. Single precision sums keep four digits of what is so many times smaller; real scenes with far
and near parts stay below 100."""


OUTERMOST = 0.05
"""Share of the points that may be left out on each side along each axis, one at least, and twice
that in all: more are a part of the scene, however far away."""


RESOLUTION = 2.0**-25
"""Distance over the size of the box below which points count as one: the winding number is summed
in single precision. Beside a sphere of 400 points, 200 in a spot of 1e-12 to 1e-8 of its size then
leave its normals as they are."""


UNRESOLVED = 4.0, 0.5
"""Distance over that one, and share of the remaining points with a neighbour as near, from which on
it is not spots that are lost but parts with a shape."""


Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cloud:
    """Distinct points of a cloud, moved and scaled into the unit cube.

    Attributes
    ----------
    points : (d, 3) float64
        In Morton order; those that are left out at the end, beyond the unit cube.
    near : (d,) bool
        False for those.
    first : (d,) int64
        Row of the cloud that each of them is.
    inverse : (n,) int64
        Which of them each row of the cloud is.
    middle, extent : (3,) float64 and float
        The cloud is ``extent * points + middle``.
    warnings : tuple of str
        What was left out, and what counts as one.
    """

    points: Array
    near: NDArray[np.bool_]
    first: NDArray[np.int64]
    inverse: NDArray[np.int64]
    middle: Array
    extent: float
    warnings: tuple[str, ...] = ()

    @property
    def frame(self) -> Frame:
        """The same as a value of its own."""
        return Frame(self.middle, self.extent)


def unit_cube(points: Array, enclosing: bool = False) -> Cloud:
    """Move and scale a cloud into the unit cube (Algorithm 1, step 1).

    Parameters
    ----------
    points : (n, 3) float64
        In any unit.
    enclosing : bool, default False
        Whether the surface shall enclose something.

    Returns
    -------
    Cloud

    Raises
    ------
    ValueError
        There are fewer than four distinct points; they are not finite, on one line, or, where they
        shall enclose something, in one plane; double precision does not hold their powers.
    """
    if len(points) < MIN_POINTS:
        raise ValueError(f"points: at least {MIN_POINTS} rows expected, got {len(points)}")
    if not finite_rows(points).all():
        raise ValueError("points: finite coordinates expected, got NaN or infinity")
    check_magnitude(points, "points")
    first, inverse = sort_unique(points)
    box = bounds(points)
    far = _far_points(points[first], box)
    if far is not None:
        return _checked(points, _parted(points, far[inverse]), enclosing)
    return _checked(points, _in_box(points, first, inverse, box), enclosing)


def _in_box(
    points: Array, first: NDArray[np.int64], inverse: NDArray[np.int64], box: tuple[Array, Array]
) -> Cloud:
    """Scale a cloud of which nothing is left out; points closer together than rounding become one.

    Two of those are neighbours along the Morton curve, unless a wall of its cells parts them. Then
    all points are rounded to a lattice of that resolution.
    """
    low, high = box
    extent = float((high - low).max())
    step = RESOLUTION * extent
    warnings: tuple[str, ...] = ()
    if extent > 0.0 and (_gaps(points[first]) < step).any():
        count = len(first)
        first, inverse = sort_unique(np.rint((points - low) / step))
        distance, share = UNRESOLVED
        if (_gaps(points[first]) < distance * step).mean() > share:
            raise ValueError(
                f"points: parts are more than {1.0 / RESOLUTION:.0e} spacings apart, which is more "
                "than arithmetic resolves: give each part on its own"
            )
        warnings = (
            f"{count - len(first)} of {len(points)} points are closer to others than "
            f"{RESOLUTION:.0e} of the extent: each such spot counts as one point",
        )
    middle = 0.5 * (low + high)
    x = np.ascontiguousarray((points[first] - middle) / (extent or 1.0))
    return Cloud(x, np.ones(len(x), bool), first, inverse, middle, extent, warnings)


def _gaps(points: Array) -> Array:
    """Largest difference of the coordinates of consecutive points, (n - 1,)."""
    return np.asarray(np.abs(np.diff(points, axis=0)).max(axis=1, initial=0.0))


def _parted(points: Array, far: NDArray[np.bool_]) -> Cloud:
    """Scale a cloud of which some points, (n,) bool, are left out."""
    rows, left = np.flatnonzero(~far), np.flatnonzero(far)
    near = points[rows]
    cloud = _in_box(near, *sort_unique(near), bounds(near))
    x = (points[left] - cloud.middle) / cloud.extent
    x *= np.minimum(1.0, FAR / np.abs(x).max(axis=1, keepdims=True))
    inverse = np.empty(len(points), np.int64)
    inverse[rows] = cloud.inverse
    inverse[left] = len(cloud.points) + np.arange(len(left))
    return Cloud(
        points=np.concatenate([cloud.points, x]),
        near=np.arange(len(cloud.points) + len(left)) < len(cloud.points),
        first=np.concatenate([rows[cloud.first], left]),
        inverse=inverse,
        middle=cloud.middle,
        extent=cloud.extent,
        warnings=(
            f"{len(left)} of {len(points)} points are farther than {0.5 * FAR:.0f} times the size "
            "of the others from them and were left out",
            *cloud.warnings,
        ),
    )


def _far_points(points: Array, box: tuple[Array, Array]) -> NDArray[np.bool_] | None:
    """Mark the distinct points that are far from all others, (d,); None where there are none."""
    most = max(1, int(OUTERMOST * len(points)))
    extent = box[1] - box[0]
    axis = int(extent.argmax())
    third, along = extent[axis] / 3.0, points[:, axis]
    spread = min((along < box[0][axis] + third).sum(), (along > box[1][axis] - third).sum())
    if spread > most or len(points) < MIN_POINTS + most:
        return None  # nearly always: the rest of the box is no smaller than a third
    inner = np.partition(points, (most, len(points) - 1 - most), axis=0)
    low, high = inner[most], inner[len(points) - 1 - most]
    size = float((high - low).max())
    if float(extent[axis]) <= FAR * size:
        return None
    far = (np.abs(points - 0.5 * (low + high)) > 0.5 * FAR * size).any(axis=1)
    rest = points[~far]
    if far.sum() > 2 * most or len(rest) < MIN_POINTS or affine_rank(rest) < 2:
        return None  # what lies around a dense spot, and is the scene
    return np.asarray(far)


def _checked(points: Array, cloud: Cloud, enclosing: bool) -> Cloud:
    """Raise unless a surface goes through the points that are left."""
    distinct = int(cloud.near.sum())
    # Repeated points have always weighed in the rank of clouds of which nothing is left out.
    rank = affine_rank(points[cloud.first[cloud.near]] if cloud.warnings else points)
    if rank < 2:
        seen = "; ".join(
            (
                "points are all equal or lie on one line: no surface goes through them",
                *cloud.warnings,
            )
        )
        raise ValueError(seen)
    if distinct < MIN_POINTS:
        raise ValueError(f"points: at least {MIN_POINTS} distinct ones expected, got {distinct}")
    if enclosing and rank == 2:
        raise ValueError("points lie in one plane and enclose nothing: closed=False gives a sheet")
    return cloud
