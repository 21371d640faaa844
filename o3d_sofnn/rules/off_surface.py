"""Outliers according to the rules (Algorithm 1, step 5, second half)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.rules.inference import infer_normals
from o3d_sofnn.rules.rule_base import RuleBase
from o3d_sofnn.rules.trust import Experience
from o3d_sofnn.sampling.outliers import COMPANY, Samples

CREDIBLE = 0.3
"""Smallest support of rules that are used to measure distances from the surface."""


LOOSE = 2.0
"""Width of their membership in the residual, divided by the normal width."""


FAR = (5.0, 0.5)
"""Distance from these rules above which points are outliers, divided by the noise level and divided
by the spacing."""


BESIDE = 0.2
"""Distance from the surface, divided by the spacing, up to which no point is an outlier."""


WITHIN = (2.0, 3.5)
"""The same distance divided by the noise level, and the distance above which every point is an
outlier. In between, it depends on how many points there are."""


def distance_along_surface(
    rules: RuleBase, points: NDArray[np.float64], sides: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Measure the distance of points from the rules that are nearest along the surface.

    The rule with the largest membership passes nearest to the point. It may follow an outlier if
    few other points support it. Leaving out such rules, and widening the membership in the
    residual, gives a rule that was not influenced by the point; beside an edge it may belong to the
    wrong face.

    Parameters
    ----------
    rules : RuleBase
        Rules fitted with sides.
    points, sides : (m, 3) float64
        Points and their unit normals, which give their sides.

    Returns
    -------
    (m,) float64
        Distances, not negative.
    """
    credible = rules.support >= CREDIBLE
    asked = rules.rows(credible) if credible.any() else rules
    asked = replace(asked, noise=LOOSE * asked.noise, residual=LOOSE * asked.residual)
    return np.abs(infer_normals(asked, points, sides=sides)[2])


def off_surface(
    residual: NDArray[np.float64],
    distance: NDArray[np.float64],
    samples: Samples,
) -> NDArray[np.bool_]:
    """Mark points that are too far from the surface of the rules.

    At some distance, noise is so unlikely that an outlier is the better explanation: there, the
    density of the points, normally distributed around the surface, falls below the density of the
    outliers, some of which are known. If most neighbours are as far away, they are not outliers but
    a detail that the rules have missed.

    Parameters
    ----------
    residual : (m,) float64
        Distance to the rule with the largest membership.
    distance : (m,) float64
        :func:`distance_along_surface`.
    samples : Samples
        The m points.

    Returns
    -------
    (m,) bool
        True for outliers.
    """
    points, scale = samples.points, samples.scale
    pilot = scale.at(points)
    noise, spacing = np.maximum(scale.noise[pilot], 1e-12), scale.spacing[pilot]
    volume = max(float(np.prod(np.ptp(points, axis=0))), 1e-12)
    rare = (len(samples.kept) - samples.kept.sum()) / volume
    dense = 1.0 / (np.sqrt(2.0 * np.pi) * noise * spacing**2)
    within = np.sqrt(2.0 * np.log(np.maximum(dense / max(rare, 1e-12), 1.0)))
    limit = np.maximum(np.clip(within, *WITHIN) * noise, BESIDE * spacing)
    far = distance > np.maximum(FAR[0] * noise, FAR[1] * spacing)
    off = (np.abs(residual) > limit) | far
    doubtful = np.flatnonzero(off)
    if len(doubtful):
        k = min(COMPANY + 1, len(points))
        around = samples.tree.query(points[doubtful], k, np.inf)[1][:, 1:]
        off[doubtful] = off[around].mean(axis=1) < 0.5
    return np.asarray(off)


def beside_surface(
    rules: RuleBase,
    samples: Samples,
    sides: NDArray[np.float64],
    experience: Experience | None,
) -> NDArray[np.bool_]:
    """Mark samples that are outliers according to the rules.

    Parameters
    ----------
    rules : RuleBase
        Rules fitted to the samples.
    samples : Samples
        The m points.
    sides : (m, 3) float64
        Unit normals of the samples, which give their sides.
    experience : Experience or None
        Off-line rules.

    Returns
    -------
    (m,) bool
        True for outliers.
    """
    points = samples.points
    residual = infer_normals(rules, points, sides=sides, experience=experience)[2]
    along = distance_along_surface(rules, points, sides)
    return off_surface(residual, along, samples)
