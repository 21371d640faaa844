"""Stage 4: structure learning of the rule base (section 3.2): generate, combine, adjust."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import consequent_errors
from o3d_sofnn.rules.inference import NEAREST, infer_normals
from o3d_sofnn.rules.refit import read_normals, revise
from o3d_sofnn.rules.rule_base import NOISE_TOLERANCE, SHAPE_TOLERANCE, RuleBase, fit_rules
from o3d_sofnn.rules.trust import Experience
from o3d_sofnn.sampling.local_fit import Neighborhoods, sides_around
from o3d_sofnn.sampling.outliers import Samples
from o3d_sofnn.sampling.scales.choice import Limits

ERROR = 3.0
"""System error, divided by the tolerance, above which a new rule is considered."""


BOUNDARY = 0.5
"""Accommodation boundary: smallest distance of a new rule from others, divided by the spacing."""


FEWEST = 12
"""Smallest number of points in a new rule: fewer than two per coefficient leave it undetermined."""


OVERLAP = 1.1
"""Factor k of eq. (10)."""


SIMILAR = (0.15, 0.99)
"""Largest distance, divided by the radius, and smallest cosine between normals of similar rules,
which are combined into one."""


SUPPORTED = 0.1
"""Share of the neighbourhood that must face the side of a rule: a fit to a few points on a wrong
side fits them perfectly, and nothing else."""


MISFIT = 0.05
"""Excess of the squared residual, divided by its typical value, at which a fit has the right size:
its shape error then about equals the error that noise causes in a fit to 100 points."""


RESIZED = (0.5, 1.25)
"""Smallest and largest number of points in a rule, divided by the typical number in the region."""


RATE = 0.5
"""Step of the gradient descent, divided by the step that would cancel the mean error of a rule."""


def generate(
    rules: RuleBase,
    points: NDArray[np.float64],
    residual: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """Find where new rules are needed: where the error is too large and no rule is near.

    Parameters
    ----------
    rules : RuleBase
        Rules so far.
    points : (n, 3) float64
        Distinct points.
    residual : (n,) float64
        System error of each point.

    Returns
    -------
    centers, n_neighbors, noise
        Arguments of :func:`o3d_sofnn.rules.rule_base.fit_rules` for the new rules only.
    """
    distance, index = rules.center_tree.query(points, 1, np.inf)
    d_min, nearest = distance[:, 0], index[:, 0]
    size, radius = rules.n_neighbors[nearest], rules.radius[nearest]
    new = (np.abs(residual) > ERROR * rules.tolerance[nearest]) & (
        d_min > BOUNDARY * rules.spacing[nearest]
    )
    width = OVERLAP * d_min[new]  # Eq. (10)
    count = np.rint(size[new] * (2.0 * width / radius[new]) ** 2).astype(np.int64)
    count = np.minimum(np.clip(count, FEWEST, size[new]), len(points))
    return points[new], np.maximum(count, min(FEWEST, len(points))), rules.noise[nearest[new]]


def reshape(
    rules: RuleBase, max_neighbors: int | None, max_radius: float | None
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Adapt the neighbourhood of each rule to the result of its first fit.

    The error of a quadric grows with the cube of the radius, so its square grows with the cube of
    the number of points; it is estimated from the excess of the residual over its typical value.
    Where it is large the neighbourhood shrinks, where the fit is good it grows; it becomes longer
    in the direction in which the surface is less curved.

    Parameters
    ----------
    rules : RuleBase
        Rules with round neighbourhoods.
    max_neighbors : int or None
        Largest neighbourhood allowed.
    max_radius : float or None
        The same as a radius, in the unit of the points.

    Returns
    -------
    n_neighbors, across, stretch
        Arguments of :func:`o3d_sofnn.rules.rule_base.fit_rules`.
    """
    # A wider fit averages the noise better; without noise there is nothing to gain. It competes
    # with the shape error, so noise is compared with that and not, as in `RuleBase.noisiness`, with
    # the spacing (which gives 8 % more Hausdorff distance on clean shapes; using this measure there
    # as well gives 4 % more).
    noisy = np.minimum(NOISE_TOLERANCE * rules.noise / (SHAPE_TOLERANCE * rules.radius), 1.0)
    widest = 1.0 + (RESIZED[1] - 1.0) * noisy
    factor = widest * np.cbrt(MISFIT / np.maximum(rules.excess, MISFIT))
    factor = np.maximum(factor, RESIZED[0])
    most = np.full(len(rules), np.inf)
    if max_neighbors is not None:
        most = np.maximum(max_neighbors / rules.n_neighbors, 1.0)
    if max_radius is not None:
        most = np.minimum(most, np.maximum((max_radius / rules.radius) ** 2, 1.0))
    factor = np.minimum(factor, most)
    least = np.minimum(rules.n_neighbors, FEWEST)
    size = np.maximum(np.rint(factor * rules.n_neighbors).astype(np.int64), least)
    across, stretch = rules.ellipses
    return size, across, np.clip(most * rules.n_neighbors / size, 1.0, stretch)


def discard(rules: RuleBase) -> RuleBase:
    """Remove rules that hardly any point of their neighbourhood supports.

    Parameters
    ----------
    rules : RuleBase
        Rules fitted with sides.

    Returns
    -------
    RuleBase
        The supported rules, or all of them if none is supported.
    """
    keep = rules.support >= SUPPORTED
    return rules.rows(keep) if keep.any() else rules


def combine(rules: RuleBase) -> RuleBase:
    """Combine rules with similar membership functions; of two, the one that fits better is kept.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.

    Returns
    -------
    RuleBase
    """
    if len(rules) < 2:
        return rules
    distance, index = rules.center_tree.query(rules.centers, 2, np.inf)
    row = np.arange(len(rules))
    other = np.where(index[:, 0] == row, index[:, 1], index[:, 0])
    normals = rules.normals
    alike = np.einsum("rd,rd->r", normals, normals[other]) > SIMILAR[1]
    near = distance[:, 1] < SIMILAR[0] * np.minimum(rules.radius, rules.radius[other])
    fit = rules.residual / rules.radius
    worse = (fit > fit[other]) | ((fit == fit[other]) & (row > other))
    mutual = other[other] == row
    return rules.rows(~(alike & near & mutual & worse))


def adjust(rules: RuleBase, points: NDArray[np.float64]) -> RuleBase:
    """Adjust the consequents by gradient descent on the squared network output at the points.

    The output, eq. (7), of the blended signed distances is zero on the surface. Its derivative with
    respect to the height of a rule is that rule's fuzzy basis function, eq. (9); the gradient of
    the squared output is their product, summed over the points.

    Parameters
    ----------
    rules : RuleBase
        Oriented rules.
    points : (n, 3) float64
        Points on the surface.

    Returns
    -------
    RuleBase
        The same rules, moved along their normals.
    """
    k = min(NEAREST, len(rules))
    gradient, share = consequent_errors(rules.plain_view, points, k)
    step = RATE * gradient / np.maximum(share, 1e-12)
    return rules.raised(step)


def grow(
    rules: RuleBase,
    samples: Samples,
    sides: NDArray[np.float64],
    limits: Limits,
    experience: Experience | None,
) -> RuleBase:
    """Learn the structure of the rule base: generate, reshape, combine, refit, adjust.

    Parameters
    ----------
    rules : RuleBase
        First rules, oriented.
    samples : Samples
        The m points that they were fitted to.
    sides : (m, 3) float64
        Unit normals of the samples, which give their sides.
    limits : Limits
        Largest neighbourhood allowed.
    experience : Experience or None
        Off-line rules.

    Returns
    -------
    RuleBase
    """
    tree, points = samples.tree, samples.points
    normals, _, residual = infer_normals(rules, points, sides=sides, experience=experience)
    facing = sides_around(rules.centers, rules.normals, normals, tree)
    centers, count, noise = generate(rules, points, residual)
    side = infer_normals(rules, centers)[0]
    size, across, stretch = reshape(rules, limits.max_nn, limits.radius)
    places = np.concatenate([rules.feet, centers])
    where = Neighborhoods(
        centers=places,
        sides=np.concatenate([facing, side]),
        n_neighbors=samples.scale.enough(np.concatenate([size, count]), places),
        noise=np.concatenate([rules.noise, noise]),
        across=np.concatenate([across, np.zeros_like(centers)]),
        stretch=np.concatenate([stretch, np.ones(len(centers))]),
    )
    rules = combine(discard(fit_rules(tree, points, normals, where)))
    read = read_normals(rules, points)
    normals[read] = infer_normals(rules, points[read], sides=sides[read], experience=experience)[0]
    rules = discard(revise(rules, tree, points, normals))
    return adjust(rules, points)
