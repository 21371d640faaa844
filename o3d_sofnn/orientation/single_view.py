"""Stage 5: sheets side by side as one place sees them, which is what a single scan records."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.geometry.vectors import unit

Array = NDArray[np.float64]


SEEN = 0.97
"""Share of a sheet that shows the same side to a place that sees it."""


HIDDEN = 0.15
"""Share of a piece in front of or behind the sheet, or of the sheet behind or in front of pieces,
rims included: more is not side by side."""


SLANT = 0.3
"""Cosine at which a place sees at least half of the sheet: under a grazing view the two sides of a
plate lie side by side."""


FEW = 100
"""Rules of the smallest piece that is judged."""


ASKED = 1500, 500
"""Rules of the sheet and of the other pieces that are asked."""


STARTS, TRIALS = (0.0, 0.5, 1.0), 60
"""Distances that the search starts from, as the reciprocal of multiples of the size of the sheet,
and places that it tries from each."""


LIKELY = 0.88
"""Share of a piece that shows one side to the first view from which on a search is worth it."""


EVEN, NEWTON = 0.01, 30
"""Weight of the length of the view that is fitted to normals, beside how well they face it,
and most steps of the fit."""


IN_VIEW = 0.05
"""Depth from which on something is in front of the viewer, over the viewer's distance."""


@dataclass(frozen=True)
class _Scene:
    """Rules of one sheet and of pieces beside it, in a frame in which the sheet has size one."""

    places: Array
    normals: Array
    sheet: NDArray[np.bool_]
    n_threads: int

    def rays(self, view: Array) -> Array:
        """Directions to the viewer, parallel if that is infinitely far away."""
        return unit(view[:3] - view[3] * self.places)

    def facing(self, view: Array) -> Array:
        """Cosine between each normal and the direction to the viewer."""
        return np.asarray(np.einsum("nd,nd->n", self.normals, self.rays(view)))

    def hidden(self, view: Array) -> NDArray[np.bool_]:
        """Which rules of the sheet and beside it cover each other, or are behind the viewer."""
        depth = 1.0 - view[3] * (self.places @ view[:3])
        image = self.places - (self.places @ view[:3])[:, None] * view[:3]
        image = image / np.maximum(depth, IN_VIEW)[:, None]
        hidden = depth < IN_VIEW
        for one in (self.sheet, ~self.sheet):
            screen = np.ascontiguousarray(image[one])
            tree = KdTree(screen, self.n_threads)
            gap = tree.query(screen, min(5, len(screen)), np.inf, self.n_threads)[0][:, -1]
            other = np.ascontiguousarray(image[~one])
            distance, nearest = tree.query(other, 1, np.inf, self.n_threads)
            hidden[~one] |= distance[:, 0] < gap[nearest[:, 0]]
        return np.asarray(hidden)


def seen_together(
    places: Array,
    normals: Array,
    areas: Array,
    piece: NDArray[np.integer],
    sheet: int,
    n_threads: int,
) -> NDArray[np.int64]:
    """Find pieces that some place sees beside an open sheet, each from one side.

    An object in front of the ground hides a part of it: in one scan it is a piece of its own whose
    rim has no neighbours, and which side of it belongs to which side of the ground is neither in
    the distances nor in the winding number, which may take both for the two sides of a wall. But
    there is a place from which both show one side and nothing is behind anything else; of the two
    sides of a wall one hides the other.

    Parameters
    ----------
    places, normals : (n, 3) float64
        Rules whose signs are consistent within each piece.
    areas : (n,) float64
        Area of each.
    piece : (n,) int
        Piece of each.
    sheet : int
        Number of the open sheet.
    n_threads : int
        Threads.

    Returns
    -------
    (pieces,) int64
        1 where a piece shows the same side as the sheet, -1 where it shows the other one, 0 where
        it is not seen like that.
    """
    size = np.bincount(piece)
    verdict = np.zeros(len(size), np.int64)
    others = np.flatnonzero((size >= FEW) & (np.arange(len(size)) != sheet))
    if size[sheet] < FEW or not len(others):
        return verdict
    middle = places[piece == sheet].mean(axis=0)
    scale = np.sqrt(((places[piece == sheet] - middle) ** 2).sum(axis=1).mean())
    local = (places - middle) / scale
    ground = _thinned(np.flatnonzero(piece == sheet), ASKED[0])
    for side in (1.0, -1.0):
        view = _fitted_view(local[ground], side * normals[ground])
        facing = np.einsum("nd,nd->n", side * normals, view[:3] - view[3] * local) > 0.0
        share = np.bincount(piece, areas * facing) / np.bincount(piece, areas)
        asked = others[np.maximum(share, 1.0 - share)[others] > LIKELY]
        if share[sheet] < SEEN or not len(asked):
            continue
        beside = _thinned(np.flatnonzero(np.isin(piece, asked)), ASKED[1])
        rows, on_sheet = (
            np.concatenate([ground, beside]),
            np.repeat([True, False], [len(ground), len(beside)]),
        )
        scene = _Scene(local[rows], side * normals[rows], on_sheet, n_threads)
        verdict += _sides_shown(scene, _single_view(scene, view), piece[beside], len(size))
    return np.sign(verdict)


def _sides_shown(
    scene: _Scene, view: Array, piece: NDArray[np.integer], count: int
) -> NDArray[np.int64]:
    """Which side each piece shows beside the sheet, (count,): 1, -1, or 0 if it is not beside."""
    cosine = scene.facing(view)
    ground = cosine[scene.sheet]
    covered = scene.hidden(view)
    if (
        (ground > 0.0).mean() < SEEN
        or np.median(ground) < SLANT
        or covered[scene.sheet].mean() > HIDDEN
    ):
        return np.zeros(count, np.int64)
    size = np.maximum(np.bincount(piece, minlength=count), 1)
    hidden = np.bincount(piece, covered[~scene.sheet], count) / size
    shown = np.bincount(piece, cosine[~scene.sheet] > 0.0, count) / size
    shown[hidden > HIDDEN] = 0.5
    asked = np.bincount(piece, minlength=count) > 0
    return np.where(asked & (shown >= SEEN), 1, np.where(asked & (shown <= 1.0 - SEEN), -1, 0))


def _thinned(rows: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """At most so many of the rows, evenly spread."""
    return rows[:: max(1, -(-len(rows) // most))]


def _fitted_view(places: Array, normals: Array) -> Array:
    """Place that the normals face, ``(direction, 1 / distance)``: a support vector machine.

    A normal faces it where ``normal . (direction - place / distance) > 0``, linear in both.
    """
    rows = np.column_stack([normals, -np.einsum("nd,nd->n", normals, places)])
    view = _separating(rows)
    if view[3] < 0.0:  # behind the sheet: then the best direction
        view = np.append(_separating(rows[:, :3]), 0.0)
    return np.asarray(view / np.maximum(np.linalg.norm(view[:3]), 1e-300))


def _separating(rows: Array) -> Array:
    """Vector whose product with most rows is above one: Newton's method, squared hinge loss."""
    vector = np.zeros(rows.shape[1])
    for _ in range(NEWTON):
        missed = rows[rows @ vector < 1.0]
        matrix = EVEN * np.eye(len(vector)) + missed.T @ missed / len(rows)
        before, vector = vector, np.linalg.solve(matrix, missed.sum(axis=0) / len(rows))
        if np.allclose(vector, before, rtol=1e-9, atol=0.0):
            break
    return vector


def _single_view(scene: _Scene, first: Array) -> Array:
    """Place from which the least is hidden while the sheet still shows one side."""
    from scipy.optimize import minimize  # rarely needed, and as slow to import as all the rest

    across = np.linalg.svd(scene.places[scene.sheet], full_matrices=False)[2][0]
    across = unit((across - (across @ first[:3]) * first[:3])[None])[0]
    axes = np.stack([across, np.cross(first[:3], across)])

    def view(x: Array) -> Array:
        return np.append(unit((first[:3] + x[:2] @ axes)[None])[0], max(x[2], 0.0))

    def badness(x: Array) -> float:
        place = view(x)
        cosine = scene.facing(place)[scene.sheet]
        unseen = max(0.0, SEEN + 0.01 - (cosine > 0.0).mean())
        slant = max(0.0, SLANT + 0.01 - float(np.median(cosine)))
        behind = max(0.0, -x[2])
        hidden = scene.hidden(place)
        lost = hidden[scene.sheet].mean() + hidden[~scene.sheet].mean()
        return float(lost + 5.0 * (unseen + slant) + 10.0 * behind)

    found = []
    for near in STARTS:
        simplex = np.array([[0, 0, near], [0.3, 0, near], [0, 0.3, near], [0, 0, near + 0.4]])
        options = {"initial_simplex": simplex, "maxfev": TRIALS, "xatol": 1e-3, "fatol": 1e-3}
        found.append(minimize(badness, simplex[0], method="Nelder-Mead", options=options))
        if found[-1].fun < 0.5 * HIDDEN:
            break
    return view(min(found, key=lambda result: result.fun).x)
