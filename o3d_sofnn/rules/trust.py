"""Off-line rules: how far a rule can be trusted at a query, learned from known shapes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.rules.rule_base import RuleBase
from o3d_sofnn.sofnn.neurons import Neurons
from o3d_sofnn.sofnn.rule_file import read_rules

Array = NDArray[np.float64]


SHIPPED = Path(__file__).parent / "off_line_rules.json"
"""The file that ``python -m o3d_sofnn.training`` writes."""


INPUTS = ("residual", "noise", "curvature", "distance", "cosine", "reach")
"""Inputs of the off-line rules. The first three belong to a rule: logarithms of the residual of its
fit and of the noise level, both divided by its radius, and of the size of its second-order
coefficients. The others belong to a query: fourth root of its distance to the quadric, cosine
between the normal there and the side, and squared distance in the tangent plane (lengths divided by
the radius)."""


OF_RULE = 3
"""How many of them belong to a rule."""


LEAST = 1e-4
"""Smallest argument of a logarithm."""


EMPHASIS = 0.5
"""Weight of the expected logarithm of the squared error in the logarithm of a membership. With 1,
memberships are inverse to the squared error, as in a mean of independent measurements; overlapping
rules are not independent."""


@dataclass(frozen=True)
class Experience:
    """A network from the inputs above to the logarithm of the squared error of a rule's normal.

    The network is the paper's own (:class:`o3d_sofnn.SOFNN`), with linear consequents and so few
    rules that they can be read. The membership of a query in a rule of the cloud is divided by the
    error that the network predicts.

    Attributes
    ----------
    network : Neurons
        At most 8 rules with one output.
    """

    network: Neurons

    @property
    def neurons(self) -> Array:
        """Return the part that depends on the query, (m, 3, 3), as the native kernels take it."""
        places = slice(OF_RULE, None)
        parts = (
            self.network.centers[:, places],
            1.0 / self.network.widths[:, places],
            -EMPHASIS * self._slopes[:, places],
        )
        return np.ascontiguousarray(np.stack(parts, axis=1))

    def gates(self, rules: RuleBase) -> Array:
        """Return the part that depends on the rules, (r, m, 2), as the native kernels take it."""
        own = slice(None, OF_RULE)
        offset = rule_inputs(rules)[:, None] - self.network.centers[:, own]
        firing = -0.5 * ((offset / self.network.widths[:, own]) ** 2).sum(axis=2)  # Eq. (11)
        said = self.network.coefficients[0, :, 0] + (offset * self._slopes[:, own]).sum(axis=2)
        return np.ascontiguousarray(np.stack([firing, -EMPHASIS * said], axis=2))

    @property
    def _slopes(self) -> Array:
        if len(self.network.coefficients) == 1:
            return np.zeros_like(self.network.centers)
        return np.asarray(self.network.coefficients[1:, :, 0].T / self.network.widths)


def rule_inputs(rules: RuleBase) -> Array:
    """Return the inputs that belong to the rules of a cloud, (r, 3)."""
    curvature = np.sqrt((rules.coefficients[:, 3:] ** 2).sum(axis=1))
    inputs = np.stack(
        [rules.residual / rules.radius, rules.noise / rules.radius, curvature], axis=1
    )
    return np.asarray(np.log(np.maximum(inputs, LEAST)))


def place_inputs(distance: Array, cosine: Array, reach: Array) -> Array:
    """Return the inputs that belong to queries, (..., 3).

    Parameters
    ----------
    distance : (...) float64
        Distance to the quadric of a rule, divided by its radius.
    cosine : (...) float64
        Cosine between the normal of the quadric and the side.
    reach : (...) float64
        Squared distance in the tangent plane, with lengths divided by the radius.
    """
    root = np.minimum(np.abs(distance), 1.0) ** 0.25
    return np.stack([root, cosine, np.minimum(reach, 4.0)], axis=-1)


@cache
def shipped() -> Experience:
    """Return the off-line rules that come with the package."""
    return Experience(read_rules(SHIPPED, INPUTS))
