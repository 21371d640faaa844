"""The unit of a cloud: its box becomes the unit cube, regardless of far points and dense spots.

All later stages compute in that unit, partly in single precision: a point far from all others
would leave no digits for them, and points closer together than rounding errors have no surface.
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
"""Size of the box of all points, divided by its size without the outermost points, above which
these are left out. At this ratio single precision still keeps four digits of the smaller part; real
scenes with far and near parts stay below 100."""


OUTERMOST = 0.05
"""Largest share of the points to leave out on each side of each axis (at least one point may be
left out), and half of the largest share in all: if there are more, they belong to the scene."""


RESOLUTION = 2.0**-25
"""Distance, divided by the size of the box, below which points count as one, since the winding
number is summed in single precision. The normals of a sphere of 400 points then do not change if
200 more points lie in a spot of 1e-12 to 1e-8 of its size."""


UNRESOLVED = 4.0, 0.5
"""Multiple of that distance, and share of the remaining points with a neighbour within it, above
which merging would destroy parts that have a shape, not just spots."""


Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cloud:
    """Distinct points of a cloud, moved and scaled into the unit cube.

    Attributes
    ----------
    points : (d, 3) float64
        Distinct points in Morton order; those left out come last, outside the unit cube.
    near : (d,) bool
        False for points that are left out.
    first : (d,) int64
        Row of the cloud of each distinct point.
    inverse : (n,) int64
        Index of the distinct point that stands for each row of the cloud.
    middle, extent : (3,) float64 and float
        The cloud is ``extent * points + middle``.
    warnings : tuple of str
        What was left out or merged.
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
        """The transformation from the unit cube to the cloud's coordinates."""
        return Frame(self.middle, self.extent)


def unit_cube(points: Array, enclosing: bool = False) -> Cloud:
    """Move and scale a cloud into the unit cube (Algorithm 1, step 1).

    Parameters
    ----------
    points : (n, 3) float64
        Points in any unit.
    enclosing : bool, default False
        Whether the surface must enclose a volume.

    Returns
    -------
    Cloud

    Raises
    ------
    ValueError
        There are fewer than four distinct points; they are not finite, or on one line, or (if they
        must enclose a volume) in one plane; double precision cannot represent their powers.
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
    """Scale a cloud without leaving out points; points closer than the resolution are merged.

    Two such points are neighbours along the Morton curve unless a cell boundary separates them. If
    there are any, all points are rounded to a lattice of that resolution.
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
    """Scale a cloud, leaving out the points in a mask, (n,) bool."""
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
    """Mark the distinct points that are far from all others, (d,); None if there are none."""
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
        return None  # the points around a dense spot are the scene
    return np.asarray(far)


def _checked(points: Array, cloud: Cloud, enclosing: bool) -> Cloud:
    """Raise unless a surface goes through the points that are left."""
    distinct = int(cloud.near.sum())
    # If nothing is left out, the rank is that of all points, including duplicates.
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
