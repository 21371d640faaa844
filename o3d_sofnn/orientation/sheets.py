"""Stage 5: sides of open sheets, and of the connected components of the rules."""

from __future__ import annotations

import dataclasses

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from o3d_sofnn.geometry.frame import Frame
from o3d_sofnn.orientation.components import pieces, turn_along
from o3d_sofnn.orientation.confidence import (
    CLOSED,
    RIM,
    SHEET,
    at_border,
    empty_in_front,
    undecided,
    winding_before,
)
from o3d_sofnn.orientation.evidence import Evidence
from o3d_sofnn.orientation.one_side import View, common_view
from o3d_sofnn.orientation.viewpoint import SURE, seen_sides
from o3d_sofnn.orientation.visibility import Partly, Station
from o3d_sofnn.rules.rule_base import RuleBase

ALIKE = 0.7
"""Smallest cosine between the planes of neighbouring rules that propagate a sign."""


NOISY = (5.0, 0.05, 0.02)
"""The winding number may see one noisy sheet as two sides. Largest rise of a step between these
sides, divided by the noise (3.2 for halves of a Gaussian); smallest share of such steps in the
component; largest share of contradictions left when it is made one sheet (thin arms leave more)."""


PATCH = 100, 0.1
"""Smallest number of rules in an open sheet, or smallest share of all rules if that is less: the
tips of thin arms are smaller components of the tree."""


SHARE = 0.01
"""Share of the surface above which components without a preferred side lead to a warning."""


RISE = 0.7
"""Largest sum of the rises of such a step from the two planes, divided by the step's length."""


def unify(
    rules: RuleBase, empty: NDArray[np.bool_]
) -> tuple[RuleBase, NDArray[np.bool_], NDArray[np.int64]]:
    """Make open sheets consistent, whose sides the winding number cannot decide.

    Hoppe et al. 1992: signs are propagated along a spanning tree of the rules whose edges prefer
    equal tangent planes; only edges that run along the surface count, so that the sides of a thin
    wall are not joined. The tree replaces the winding number's signs only on a connected component
    that is open (the winding number one spacing in front of it is not zero, or its two sides are no
    farther apart than noise alone would put them) and only if it leaves less than half as many
    contradicting edges; the component keeps the side that most of it had.

    Parameters
    ----------
    rules : RuleBase
        Rules with the signs of the winding number.
    empty : (r,) bool
        Whether there is nothing in front of each rule.

    Returns
    -------
    rules : RuleBase
        The same rules, oriented consistently.
    replaced : (r,) bool
        Rules whose sign comes from the tree.
    sheet : (r,) int64
        Number of the sheet that each rule belongs to.
    """
    n, normals, feet = len(rules), rules.normals, rules.feet
    index = rules.foot_tree.query(feet, min(9, n), np.inf)[1][:, 1:]
    a, b = np.repeat(np.arange(n), index.shape[1]), index.ravel()
    step = feet[b] - feet[a]
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-300)
    rise = np.abs(np.einsum("ed,ed->e", step, normals[a])) + np.abs(
        np.einsum("ed,ed->e", step, normals[b])
    )
    cosine = np.einsum("ed,ed->e", normals[a], normals[b])
    along = (np.abs(cosine) > ALIKE) & (rise < RISE * length)
    a, b, cosine, rise = a[along], b[along], cosine[along], rise[along]
    graph = scipy.sparse.coo_matrix((1.0 - np.abs(cosine) + 1e-6, (a, b)), shape=(n, n)).tocsr()
    tree = scipy.sparse.csgraph.minimum_spanning_tree(graph.maximum(graph.T))
    piece = scipy.sparse.csgraph.connected_components(tree, directed=False)[1]
    sign = _signs_along(tree, normals, piece)
    area = rules.areas
    side = np.bincount(piece, area * sign)
    sign = sign * np.where(side < 0, -1.0, 1.0)[piece]
    pieces_of_edges, count = piece[a], int(piece.max()) + 1
    before = np.bincount(pieces_of_edges, cosine < 0, count)
    after = np.bincount(pieces_of_edges, sign[a] * sign[b] * cosine < 0, count)
    closed = np.bincount(piece, area * empty) / np.bincount(piece, area)
    within_noise = (cosine < 0) & (rise < NOISY[0] * np.maximum(rules.noise[a], rules.noise[b]))
    edges = np.bincount(pieces_of_edges, minlength=count)
    noisy = np.bincount(pieces_of_edges, within_noise, count) > NOISY[1] * edges
    is_open = closed < CLOSED
    sheet = (noisy & (after <= NOISY[2] * before)) | (is_open & (after < 0.5 * before))
    sheet &= np.bincount(piece) >= min(PATCH[0], PATCH[1] * n)
    replaced = sheet[piece]
    turned = rules.facing(normals * np.where(replaced, sign, 1.0)[:, None])
    return turned, replaced, piece.astype(np.int64)


def _signs_along(
    tree: scipy.sparse.csr_matrix, normals: NDArray[np.float64], piece: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Return the sign of each node relative to the first of its component, along the tree."""
    n = len(normals)
    first = np.unique(piece, return_index=True)[1]
    rows = np.concatenate([np.full(len(first), n), tree.tocoo().row])
    columns = np.concatenate([first, tree.tocoo().col])
    rooted = scipy.sparse.coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(n + 1, n + 1))
    order, parent = scipy.sparse.csgraph.breadth_first_order(rooted.tocsr(), n, directed=False)
    parent[n] = n
    relative = np.ones(n + 1)
    inner = np.flatnonzero(parent[:n] < n)
    product = np.einsum("rd,rd->r", normals[inner], normals[parent[inner]])
    relative[inner] = np.where(product < 0, -1.0, 1.0)
    sign = relative.copy()
    above = parent.copy()
    for _ in range(int(np.ceil(np.log2(len(order) + 1))) + 1):  # pointer doubling up the tree
        sign, above = sign * np.where(above < n, sign[above], 1.0), above[above]
    return sign[:n]


def settle(
    rules: RuleBase,
    sides: NDArray[np.float64],
    points: NDArray[np.float64],
    doubtful: Evidence | None,
    frame: Frame,
) -> tuple[RuleBase, NDArray[np.float64], Evidence]:
    """Turn open surfaces towards the place they were seen from.

    Closed components keep the sides of the winding number: they face outward.

    Parameters
    ----------
    rules : RuleBase
        Rules with the signs of the winding number.
    sides, points : (n, 3) float64
        Points and their sides, consistent with the rules.
    doubtful : Evidence or None
        A station that is trusted for open surfaces only.
    frame : Frame
        The unit cube of the rules and points.

    Returns
    -------
    rules : RuleBase
        The rules with their new sides.
    sides : (n, 3) float64
        The new sides of the points.
    evidence : Evidence
        How the sides were decided.
    """
    empty = empty_in_front(rules)
    turned, replaced, sheet = unify(rules, empty)
    winding = winding_before(turned, (0.0,))[0]
    is_open = _open_rules(rules, empty)
    share = float(rules.areas[is_open].sum() / rules.areas.sum())
    evidence = Evidence("outward", "sides: outward, by the winding number", {"open": share})
    seen = None
    if share > SHARE:
        view = _view_of(doubtful, frame) or common_view(
            turned.rows(is_open), winding[is_open], frame.origin
        )
        if view is not None:
            seen = Partly(view.station, turned.feet, is_open)
            evidence = _seen(view, share, seen.outside(frame))
            directions = seen.directions(turned.feet)
            if evidence.decided:
                normals = seen_sides(directions, turned.normals, turned.feet)
            else:
                normals = _sheets_along(directions, turned, sheet)
            turned = turned.facing(normals)
    if not evidence.decided:
        turned, warnings = face_up(turned, undecided(turned))
        evidence = dataclasses.replace(evidence, warnings=warnings)
    sides = turn_along(sides, points, rules, turned, replaced)
    if seen is not None and evidence.decided:
        sides = seen_sides(seen.directions(points), sides, points)
    return turned, sides, evidence


def _view_of(doubtful: Evidence | None, frame: Frame) -> View | None:
    if doubtful is None or not isinstance(doubtful.sight, Station):
        return None
    station = Station(frame.inside(doubtful.sight.place))
    return View(doubtful.kind, station, doubtful.figures["hidden"])


def _sheets_along(
    directions: NDArray[np.float64], rules: RuleBase, sheet: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Turn large sheets as a whole to a direction they clearly face; return normals, (r, 3)."""
    facing = np.einsum("rd,rd->r", rules.normals, directions)
    lean = np.bincount(sheet, rules.areas * facing) / np.bincount(sheet, rules.areas)
    large = np.bincount(sheet) >= min(PATCH[0], PATCH[1] * len(rules))
    turn = (large & (lean < -SURE))[sheet]
    return np.where(turn[:, None], -rules.normals, rules.normals)


def _open_rules(rules: RuleBase, empty: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mark rules of open components: something in front of them, a long border, or too small."""
    piece, areas = pieces(rules), rules.areas
    area = np.bincount(piece, areas)
    opened = np.bincount(piece, areas * empty) < CLOSED * area
    opened |= np.bincount(piece, areas * at_border(rules)) > RIM * area
    opened |= np.bincount(piece) < SHEET
    return np.asarray(opened[piece])


TEXTS = {
    "density": "the scanner, whose position follows from the density of the points",
    "height field": "up, like level ground seen from above",
    "camera": "the origin, like the images of a camera that has not moved far",
    "one side": "the direction from which they look convex",
}


def _seen(view: View, share: float, sight: Partly) -> Evidence:
    text = (
        f"sides: open surfaces, {100.0 * share:.0f} % of all, face {TEXTS[view.kind]}; "
        f"{100.0 * view.hidden:.0f} % are hidden from there"
    )
    figures = {"open": share, "hidden": view.hidden}
    return Evidence(view.kind, text, figures, None if view.kind == "one side" else sight)


def face_up(rules: RuleBase, toss: NDArray[np.bool_]) -> tuple[RuleBase, tuple[str, ...]]:
    """Turn all components without an outer side up, as a whole.

    Elsewhere the winding number has decided: closed surfaces face outward, an open sheet faces the
    side from which it looks convex as a whole (a bowl and the walls of a room face their outside).

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    toss : (r,) bool
        Rules of those components.

    Returns
    -------
    rules : RuleBase
        The mean normal of those components has a positive z or, if it is level, a positive y or x.
    warnings : tuple of str
        A warning that states their share of the surface.
    """
    share = float(rules.areas[toss].sum() / rules.areas.sum())
    if not share:
        return rules, ()
    lean = rules.areas[toss] @ rules.normals[toss]
    up = next((x for x in lean[::-1] if abs(x) > 0.1 * np.linalg.norm(lean)), 1.0)
    turned = rules.facing(rules.normals * np.where(toss & (up < 0), -1.0, 1.0)[:, None])
    if share < SHARE:
        return turned, ()
    return turned, (
        f"{100.0 * share:.0f} % of the surface are open sheets without an outer side: they face "
        "up; give viewpoint or towards to choose",
    )
