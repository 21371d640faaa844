"""What a user may choose: one set of options for Python, the command line and MeshLab."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn import validation

OF_NORMALS = ("max_nn", "radius", "viewpoint", "towards", "n_threads")
"""Options of both operators; all others are for the surface alone."""


@dataclass(frozen=True)
class Options:
    """Options of both operators; the defaults need no tuning.

    Attributes
    ----------
    max_nn : int, optional
        Largest number of points in a local fit. None chooses from the data.
    radius : float, optional
        Largest radius of a local fit, in the unit of the points.
    viewpoint : (3,) or (n, 3) float64, optional
        Where the scanner stood, for all points or for each of them: every normal faces it, and
        points that hang between objects, as seen from there, count as outliers.
    towards : (3,) float64, optional
        The same for a scanner that is far away: a direction that every normal faces.
    n_threads : int, default -1
        Number of threads; -1 uses one per core. The result does not depend on it.
    depth : int, optional
        The longest side of the bounding box of the inliers is divided into ``2**depth`` cubes
        (1 to 16).
    voxel_size : float, optional
        Edge of a cube, in the unit of the points. Without `depth` and `voxel_size` it is chosen
        from spacing, noise and curvature.
    closed : bool or "auto", default "auto"
        True closes the mesh whatever the data show, False leaves every hole open. "auto" closes
        solids, as far as the data show them, and small holes elsewhere.
    trim : float or "auto", optional
        Cut away everything with a confidence below this (0 to 1), instead of what `closed` says.
        "auto" is another name for ``closed="auto"``.
    target_triangles : int, optional
        Collapse edges until this many triangles are left. None keeps all.
    precision : float, optional
        Largest allowed residual of the local surfaces (epsilon of Algorithm 2), in the unit of the
        points. None derives it from noise and size.
    """

    max_nn: int | None = None
    radius: float | None = None
    viewpoint: NDArray[np.float64] | None = None
    towards: NDArray[np.float64] | None = None
    n_threads: int = -1
    depth: int | None = None
    voxel_size: float | None = None
    closed: bool | Literal["auto"] = "auto"
    trim: float | Literal["auto"] | None = None
    target_triangles: int | None = None
    precision: float | None = None

    @classmethod
    def checked(cls, n_points: int, *, use_normals: bool = False, **fields: Any) -> Options:
        """Check the options that a user has given.

        Parameters
        ----------
        n_points : int
            Number of points in the cloud, including those without finite coordinates.
        use_normals : bool, default False
            Whether the sides are taken from the cloud's own normals.
        **fields
            Attributes of this class by name; array_like where it has arrays.

        Returns
        -------
        Options

        Raises
        ------
        ValueError
            An option is out of range, or two exclude each other; the message names them.
        """
        given = cls(**fields)
        validation.check_exclusive(depth=given.depth, voxel_size=given.voxel_size)
        validation.check_exclusive(
            trim=given.trim, closed=None if validation.is_auto(given.closed) else given.closed
        )
        validation.check_exclusive(
            use_normals=validation.check_flag(use_normals, "use_normals") or None,
            viewpoint=given.viewpoint,
            towards=given.towards,
        )
        return cls(
            max_nn=validation.check_integer(given.max_nn, "max_nn", validation.MIN_NEIGHBORS),
            radius=validation.check_positive(given.radius, "radius"),
            viewpoint=validation.check_viewpoint(given.viewpoint, n_points, "viewpoint"),
            towards=validation.check_direction(given.towards, "towards"),
            n_threads=validation.check_n_threads(given.n_threads),
            depth=validation.check_integer(given.depth, "depth", 1, validation.MAX_DEPTH),
            voxel_size=validation.check_positive(given.voxel_size, "voxel_size"),
            closed=validation.check_closed(given.closed),
            trim=validation.check_trim(given.trim),
            target_triangles=validation.check_integer(
                given.target_triangles, "target_triangles", 4
            ),
            precision=validation.check_positive(given.precision, "precision"),
        )

    @property
    def closes(self) -> bool | Literal["auto"]:
        """How holes are treated: as `closed` says, unless there is a level to cut at."""
        return self.closed if self.trim in (None, "auto") else False

    def of_rows(self, mask: NDArray[np.bool_]) -> Options:
        """Return the options for the rows of the cloud in a mask, (n,) bool."""
        if self.viewpoint is None or self.viewpoint.ndim == 1 or mask.all():
            return self
        return replace(self, viewpoint=self.viewpoint[mask])
