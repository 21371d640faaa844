"""Training samples from known shapes: queries, the rules around them, and the error of each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.algorithm1 import learn_rules
from o3d_sofnn.options import Options
from o3d_sofnn.progress import Clock
from o3d_sofnn.reference.rules.inference import log_memberships
from o3d_sofnn.reference.rules.rules import Rules
from o3d_sofnn.rules.inference import NEAREST
from o3d_sofnn.rules.trust import place_inputs, rule_inputs

Array = NDArray[np.float64]

ANGLES = (0.01, 1.2)
"""Range to which errors are clipped, in radians."""
SOFTNESS = 0.3
"""Power of the memberships by which pairs are drawn: rules with a small share may be right."""


@dataclass(frozen=True)
class Lessons:
    """Some queries of one cloud, each with its nearest rules.

    Attributes
    ----------
    inputs : (p, k, 6) float64
        Inputs of the off-line rules (:data:`o3d_sofnn.rules.trust.INPUTS`).
    memberships : (p, k) float64
        Logarithm of the membership without off-line rules.
    normals : (p, k, 3) float64
        Normal according to each rule.
    truth : (p, 3) float64
        Reference normals.
    """

    inputs: Array
    memberships: Array
    normals: Array
    truth: Array

    @property
    def outputs(self) -> Array:
        """Return the logarithm of the squared angle of each rule's normal to the truth, (p, k)."""
        cosine = np.abs(np.einsum("pkd,pd->pk", self.normals, self.truth))
        angle = np.clip(np.arccos(np.clip(cosine, 0.0, 1.0)), *ANGLES)
        return np.asarray(2.0 * np.log(angle))

    def error(self, trust: Array | float) -> float:
        """Return the root-mean-square angle of normals inferred with (p, k) log-trusts."""
        membership = self.memberships + trust
        share = np.exp(membership - membership.max(axis=1, keepdims=True))
        mean = np.einsum("pk,pkd->pd", share, self.normals)  # Eq. (7), except for its length
        cosine = np.einsum("pd,pd->p", mean, self.truth) / np.linalg.norm(mean, axis=1)
        return float(np.sqrt(np.mean(np.arccos(np.clip(np.abs(cosine), 0.0, 1.0)) ** 2)))


def lessons(points: Array, normals: Array, count: int) -> Lessons:
    """Learn the rules of a cloud and compare them with reference normals at evenly spread points.

    Parameters
    ----------
    points, normals : (n, 3) float64
        Points and reference normals.
    count : int
        Number of queries.

    Returns
    -------
    Lessons
    """
    learned = learn_rules(points, Options(), Clock(None))
    base = learned.rules
    row = np.linspace(0, len(learned.sides) - 1, count).astype(np.int64)
    x, side = learned.samples.points[row], learned.sides[row]
    truth = normals[learned.cloud.first[learned.samples.kept][row]]
    near = base.center_tree.query(x, min(NEAREST, len(base)), np.inf)[1]
    rules = Rules(
        base.centers,
        base.frames,
        base.coefficients,
        base.radius,
        base.stretch,
        base.tolerance,
        base.quality,
    )
    found = [
        log_memberships(rules.rows(index), place, way)
        for index, place, way in zip(near, x, side, strict=True)
    ]
    said = np.stack([rule.normal for _, rule in found])
    distance = np.stack([rule.residual for _, rule in found]) / base.radius[near]
    cosine = np.einsum("pkd,pd->pk", said, side)
    reach = np.stack([rule.reach for _, rule in found])
    inputs = np.concatenate(
        [rule_inputs(base)[near], place_inputs(distance, cosine, reach)], axis=2
    )
    return Lessons(inputs, np.stack([membership for membership, _ in found]), said, truth)


def draw_pairs(
    clouds: Iterable[Lessons], count: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Draw `count` pairs of a query and a rule from each cloud, preferring rules that count.

    Returns
    -------
    inputs : (n, 6) float64
    outputs : (n,) float64
    """
    inputs, outputs = [], []
    for cloud in clouds:
        membership = SOFTNESS * cloud.memberships
        share = np.exp(membership - membership.max(axis=1, keepdims=True))
        share = (share / share.sum(axis=1, keepdims=True)).ravel()
        row = rng.choice(len(share), count, p=share / share.sum())
        inputs.append(cloud.inputs.reshape(len(share), -1)[row])
        outputs.append(cloud.outputs.ravel()[row])
    return np.concatenate(inputs), np.concatenate(outputs)
