"""Reconstruction of what arrives sweep by sweep."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from o3d_sofnn import pipeline, validation
from o3d_sofnn.adapters import CloudArrays
from o3d_sofnn.online import storage
from o3d_sofnn.online.cells import Cells, edge_for
from o3d_sofnn.operators.common import finite_points, own_box, rows_of, warn
from o3d_sofnn.operators.families import Arrays, family_of
from o3d_sofnn.options import Options
from o3d_sofnn.orientation.components import pieces
from o3d_sofnn.results import SurfaceEstimate
from o3d_sofnn.rules.inference import infer_normals
from o3d_sofnn.rules.rule_base import RuleBase
from o3d_sofnn.rules.trust import shipped
from o3d_sofnn.threads import using_threads

Array = NDArray[np.float64]

CHOICES = (
    *("max_nn", "radius", "n_threads", "depth", "voxel_size", "closed", "trim"),
    *("target_triangles", "precision", "towards"),
)
"""Options of :func:`o3d_sofnn.reconstruct_surface` that belong to the whole, not to one sweep."""


class OnlineReconstruction:
    """A surface that is learned from sweeps of a scanner as they arrive, in any order.

    Points are absorbed into cells of a lattice: overlapping or repeated sweeps need no more memory,
    and the order of the sweeps makes no difference but for the size of the cells, which the first
    sweep decides (half its spacing, a power of two).

    Parameters
    ----------
    **options
        Those of :func:`o3d_sofnn.reconstruct_surface` but for `viewpoint`, which belongs to each
        sweep, and `use_normals`.

    Raises
    ------
    TypeError
        There is no such option.
    ValueError
        An option is out of range.

    Examples
    --------
    >>> model = OnlineReconstruction()
    >>> model.add(first_sweep, viewpoint=(0.0, 0.0, 2.0))
    >>> model.add(next_sweep, viewpoint=(1.0, 0.0, 2.0))
    >>> mesh = model.mesh()
    """

    def __init__(self, **options: Any) -> None:
        unknown = sorted(set(options) - set(CHOICES))
        if unknown:
            raise TypeError(f"{unknown[0]}: expected one of {', '.join(CHOICES)}")
        self._options = Options.checked(1, **options)
        self._cells: Cells | None = None
        self._like: Any = None
        self._surface: SurfaceEstimate | None = None
        self._rules: RuleBase | None = None
        self._before: RuleBase | None = None
        self.turned: Array = np.zeros((0, 3))
        """Middles, (k, 3), of the components that have changed sides since the last mesh."""

    def __len__(self) -> int:
        """Return the number of cells that hold points."""
        return 0 if self._cells is None else len(self._cells)

    def __repr__(self) -> str:
        """Return how much it holds."""
        points = 0 if self._cells is None else int(self._cells.count.sum())
        return f"OnlineReconstruction({points} points in {len(self)} cells)"

    def add(self, pcd: Any, viewpoint: ArrayLike | None = None) -> None:
        """Add the points of a cloud: the first one, or the next sweep.

        Parameters
        ----------
        pcd : (n, 3) array_like or cloud
            What :func:`o3d_sofnn.reconstruct_surface` takes. Points that are not finite are left
            out with a warning.
        viewpoint : (3,) or (n, 3) array_like, optional
            Where the scanner stood. If it is known of all sweeps, all surfaces face it.

        Raises
        ------
        ValueError
            `pcd` has fewer than 4 finite points, or the viewpoint does not fit.
        """
        family = family_of(pcd)
        cloud = family.read(pcd)
        place = validation.check_viewpoint(viewpoint, len(cloud.points), "viewpoint")
        finite = finite_points(cloud)
        points = rows_of(cloud.points, finite)
        if place is not None and place.ndim == 2:
            place = place[finite]
        if self._cells is None:
            with using_threads(self._options.n_threads):
                edge = edge_for(points)
            self._cells, self._like = Cells.of(points, edge, place), pcd
        else:
            self._cells = self._cells.joined(Cells.of(points, self._cells.edge, place))
        self._forget()

    def remove(self, box: Any) -> int:
        """Remove what lies in a box.

        Parameters
        ----------
        box : open3d AxisAlignedBoundingBox or (2, 3) array_like
            The box, or its lower and upper corner.

        Returns
        -------
        int
            Number of cells that were removed.

        Raises
        ------
        ValueError
            It is no box.
        """
        low, high = own_box(box)
        if self._cells is None:
            return 0
        before = len(self)
        self._cells = self._cells.without(low, high)
        if len(self) < before:
            self._forget()
        return before - len(self)

    @overload
    def mesh(self) -> Any: ...
    @overload
    def mesh(self, *, return_details: Literal[True]) -> tuple[Any, ...]: ...

    def mesh(self, *, return_details: bool = False) -> Any:
        """Return the mesh of all that has been added and not removed.

        Parameters
        ----------
        return_details : bool, default False
            Also return details, as :func:`o3d_sofnn.reconstruct_surface` does; their points are
            those of the cells.

        Returns
        -------
        mesh
            Of the kind that belongs to the first cloud; ``(vertices, triangles)`` for arrays and
            after :meth:`load`.

        Raises
        ------
        ValueError
            There are fewer than 4 cells with points, or they define no surface.

        Notes
        -----
        If a component faces the other side than in the last mesh, since its sides are found from
        the points and an object was incomplete, there is a warning, and :attr:`turned` holds it.
        """
        return_details = validation.check_flag(return_details, "return_details")
        if self._surface is None:
            cells = self._filled()
            options = self._options_here(cells)
            self._surface = pipeline.reconstruct_surface(cells.points, options)
            self._note(self._surface.normals.rules)
            warn(*self._surface.warnings)
        found = self._surface
        vertices = CloudArrays(found.vertices.copy(), found.vertex_normals.copy())
        family = Arrays() if self._like is None else family_of(self._like)
        mesh = family.mesh(self._like, vertices, found.triangles.copy())
        if not return_details:
            return mesh
        return (*mesh, found) if isinstance(mesh, tuple) else (mesh, found)

    def estimate_normals(self, pcd: Any) -> Any:
        """Estimate normals at the points of a cloud by the rules of all that has been added.

        Parameters
        ----------
        pcd : (n, 3) array_like or cloud
            Points on or near the surface, of any kind.

        Returns
        -------
        As :func:`o3d_sofnn.estimate_normals`; normals of points that are not finite are zero.

        Raises
        ------
        ValueError
            Fewer than 4 cells hold points, or they define no surface.
        """
        family = family_of(pcd)
        cloud = family.read(pcd)
        finite = validation.finite_rows(cloud.points)
        if self._rules is None:
            cells = self._filled()
            estimate = pipeline.estimate_normals(cells.points, self._options_here(cells))
            self._note(estimate.rules)
            warn(*estimate.warnings)
        rules = self._rules
        assert rules is not None
        middle = rules.centers.mean(axis=0)
        extent = max(float(np.ptp(rules.centers, axis=0).max()), 1e-300)
        normals = np.zeros_like(cloud.points)
        with using_threads(self._options.n_threads):
            near = rules.moved(1.0 / extent, -middle / extent)
            x = np.ascontiguousarray((cloud.points[finite] - middle) / extent)
            normals[finite] = infer_normals(near, x, experience=shipped())[0]
        return family.with_normals(pcd, normals)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write what has been learned to a file (NPZ), whole or not at all."""
        usual = Options()
        chosen = {
            name: value
            for name in CHOICES
            if (value := getattr(self._options, name)) is not getattr(usual, name)
        }
        storage.write(path, self._cells, chosen)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> OnlineReconstruction:
        """Read what :meth:`save` has written.

        Raises
        ------
        ValueError
            The file holds something else.
        OSError
            The file cannot be read.
        """
        cells, options = storage.read(path)
        model = cls(**options)
        model._cells = cells
        return model

    def _filled(self) -> Cells:
        """Return the cells, if there are enough of them."""
        if self._cells is None or len(self) < validation.MIN_POINTS:
            raise ValueError(
                f"expected points in at least {validation.MIN_POINTS} cells, got {len(self)}: add "
                "a cloud first"
            )
        return self._cells

    def _options_here(self, cells: Cells) -> Options:
        """Return the options, with what is known of where the points were seen from."""
        viewpoint = None if self._options.towards is not None else cells.viewpoint
        return replace(self._options, viewpoint=viewpoint)

    def _forget(self) -> None:
        """Drop what was learned before the points changed, but for the sides."""
        self._surface = self._rules = None

    def _note(self, rules: RuleBase) -> None:
        """Keep the rules, and tell which components have turned since the last ones."""
        self._rules = rules
        if self._before is not None:
            with using_threads(self._options.n_threads):
                self.turned = turned(self._before, rules)
            if len(self.turned):
                warn(
                    f"{len(self.turned)} components face the other side than before the last "
                    "points were added: their sides are found from the points. Give viewpoint or "
                    "towards to decide them"
                )
        self._before = rules


def turned(before: RuleBase, after: RuleBase) -> Array:
    """Return the middles, (k, 3), of components of which most area faces another side than before.

    Parameters
    ----------
    before, after : RuleBase
        Rules in the same coordinates.
    """
    distance, index = before.foot_tree.query(after.feet, 1, np.inf)
    known = distance[:, 0] <= before.radius[index[:, 0]]
    same = np.einsum("rd,rd->r", after.normals, before.normals[index[:, 0]])
    vote = after.areas * np.sign(same) * known
    piece = pieces(after)
    against = np.flatnonzero(np.bincount(piece, vote) < 0.0)
    return np.array([after.feet[piece == one].mean(axis=0) for one in against]).reshape(-1, 3)
