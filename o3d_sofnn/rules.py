"""Stage 4: one local fit for each typical datum, and what the rules say about a place."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import _kernels
from .experience import Experience
from .rule_base import RuleBase

NEAREST = 12
"""Rules that take part in the inference at one place."""
ROBUST = 2.0
"""Width of the residual weight in the second fit, over the noise level."""


def fit_rules(
    points: NDArray[np.float64],
    tree: _kernels.KdTree,
    centers: NDArray[np.float64],
    n_neighbors: NDArray[np.int64],
    noise: NDArray[np.float64],
    n_threads: int,
    *,
    normals: NDArray[np.float64],
    sides: NDArray[np.float64],
    confidence: NDArray[np.float64] | None = None,
    across: NDArray[np.float64] | None = None,
    stretch: NDArray[np.float64] | None = None,
) -> RuleBase:
    """Fit one quadric around each centre (Algorithm 1, steps 3 and 5).

    Parameters
    ----------
    points : (n, 3) float64
        Distinct points.
    tree : KdTree
        Over `points`.
    centers : (r, 3) float64
        Where the fits are made.
    n_neighbors : (r,) int64
        Points in each fit.
    noise : (r,) float64
        Noise level at each centre.
    n_threads : int
        Threads.
    normals, sides : (n, 3) and (r, 3) float64
        Oriented normals of the points and of the rules. A point enters a fit by the
        square of the cosine between its normal and the rule's, and not at all when it faces the
        other way: the two sides of a thin sheet and the two faces of an edge are kept apart.
    confidence : (r,) float64, optional
        Of the sides, kept with the rules; 1 when not given.
    across, stretch : (r, 3) and (r,) float64, optional
        Tangents along which the neighbourhoods are narrow, and how many times longer than wide
        they are, at the same area. Round when not given.

    Returns
    -------
    RuleBase
    """
    stretch = np.ones(len(centers)) if stretch is None else stretch
    _, frames, coefficients, info = _kernels.fit_rules(
        tree,
        points,
        centers,
        n_neighbors,
        ROBUST * noise,
        3,
        normals,
        sides,
        across,
        stretch,
        n_threads,
    )
    rules = RuleBase(
        centers,
        np.asarray(frames),
        np.asarray(coefficients),
        np.maximum(info[:, 2], 1e-300),
        stretch,
        np.asarray(info[:, 0]),
        np.asarray(info[:, 4]),
        noise,
        n_neighbors,
        np.ones(len(centers)) if confidence is None else confidence,
    )
    return rules.facing(sides)


def infer_normals(
    rules: RuleBase,
    x: NDArray[np.float64],
    n_threads: int,
    *,
    sides: NDArray[np.float64] | None = None,
    k: int = NEAREST,
    experience: Experience | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Infer a normal at every point, eq. (7) and (9).

    The membership of a point in a rule is the product of a Gaussian in the tangent plane, a
    Gaussian in the residual to the quadric, and the rule's quality, so that a point takes its
    normal from the face of an edge or the side of a sheet it lies on.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    x : (n, 3) float64
        Where the normal is wanted.
    n_threads : int
        Threads.
    sides : (n, 3) float64, optional
        Unit vectors out of the surface at each place, as far as they are known; (0, 0, 0) where
        they are not. A Gaussian in the angle to the normal of the rule joins the membership: on
        parts hardly thicker than the noise the residual alone does not tell the sides apart.
    k : int, default 12
        Nearest rules that take part.
    experience : Experience, optional
        Off-line rules: the trust that they put in a rule at a place joins the membership.

    Returns
    -------
    normals : (n, 3) float64
        Unit normals.
    agreement : (n,) float64
        Length of the mean normal of the rules that took part, 0 to 1.
    residual : (n,) float64
        Signed distance to the quadric of the rule with the largest membership.
    """
    view = rules.view(n_threads, experience)
    normals, info = _kernels.infer_normals(view, x, sides, min(k, len(rules)), n_threads)
    return np.asarray(normals), np.asarray(info[:, 0]), np.asarray(info[:, 1])
