"""What each stage brings to the normals: ``python normal_stages.py MESH ...``.

Prints the root-mean-square angle in degrees to the true normals, mean of all meshes: each row with
all stages before it. Then the error with off-line rules, and with these learned further on-line on
the cloud at hand, over that without off-line rules.
"""

from __future__ import annotations

import copy
import sys
from collections.abc import Iterator
from dataclasses import replace
from unittest.mock import patch

import numpy as np
from normals import planes
from numpy.typing import NDArray
from truth import Case, Cloud, draw, parser

from o3d_sofnn import algorithm1, pipeline
from o3d_sofnn._kernels import KdTree, fit_scales
from o3d_sofnn.geometry.vectors import bounds
from o3d_sofnn.orientation.winding_normals import orient_points
from o3d_sofnn.rules.inference import infer_normals
from o3d_sofnn.rules.rule_base import RuleBase, fit_rules
from o3d_sofnn.rules.trust import EMPHASIS, INPUTS, shipped
from o3d_sofnn.sampling.cells import sort_unique
from o3d_sofnn.sampling.local_fit import Neighborhoods
from o3d_sofnn.sampling.scales.choice import Limits, choose_scale
from o3d_sofnn.sampling.scales.refinement import refine_scale
from o3d_sofnn.sampling.typical_data import typical_data
from o3d_sofnn.sofnn.estimator import SOFNN
from o3d_sofnn.training.lessons import draw_pairs, lessons

Array = NDArray[np.float64]

ANY = 1e3
"""Width of a membership in the residual that takes everything, over the radius."""


def main() -> int:
    """Print both tables."""
    found = parser(__doc__, noise=(0.0, 0.25, 0.5))
    found.add_argument("--pairs", type=int, default=300, help="that on-line learning sees")
    options = found.parse_args()
    names: list[str] = []
    table: list[list[float]] = []
    learned: list[Array] = []
    for noise in options.noise:
        rows, ratios = [], []
        for file in options.meshes:
            cloud = draw(Case(file, options.n, noise))
            print(f"{file.stem}, noise {noise:g} %", file=sys.stderr, flush=True)
            found = list(stages(cloud))
            names = [name for name, _ in found]
            rows.append([error for _, error in found])
            ratios.append(networks(cloud, options.pairs))
        table.append(list(np.mean(rows, axis=0)))
        learned.append(np.exp(np.mean(np.log(ratios), axis=0)))
    head = " | ".join(f"{noise:g} %" for noise in options.noise)
    print(f"| stages | {head} |\n|{'---|' * (1 + len(options.noise))}")
    for name, errors in zip(names, np.transpose(table), strict=True):
        print(f"| {name} | " + " | ".join(f"{error:.2f}" for error in errors) + " |")
    print(f"\n| rules of trust | {head} |\n|{'---|' * (1 + len(options.noise))}")
    ways = ["off-line", "and on-line, told by the inferred normals", "and on-line, told the truth"]
    for name, errors in zip(ways, np.transpose(learned), strict=True):
        print(f"| {name} | " + " | ".join(f"{error:.3f}" for error in errors) + " |")
    return 0


def stages(cloud: Cloud) -> Iterator[tuple[str, float]]:
    """Yield the name of each stage and the error with it and all before it."""
    order, _ = sort_unique(cloud.points)
    low, high = bounds(cloud.points)
    x = np.ascontiguousarray((cloud.points[order] - 0.5 * (low + high)) / (high - low).max())
    truth = Cloud(x, cloud.normals[order], cloud.inliers[order])
    tree = KdTree(x, -1)
    yield "plane, k = 30 (Open3D)", truth.error(planes(truth))
    scale = choose_scale(x, tree, Limits())
    size = scale.n_neighbors[scale.at(x)]
    quadrics = np.zeros_like(x)
    for k in np.unique(size):
        row = np.flatnonzero(size == k)
        quadrics[row] = fit_scales(tree, x, x[row], np.array([k]))[0][:, 0]
    yield "quadric at the scale found", truth.error(quadrics)

    noise, spacing = float(np.median(scale.noise)), float(np.median(scale.spacing))
    sides = orient_points(x, noise, spacing)
    same = np.tile([0.0, 0.0, 1.0], (len(x), 1))  # nobody is told apart

    def rules_with(known: Array) -> RuleBase:
        centers, facing = typical_data(x, known, tree, scale)
        pilot = scale.at(centers)
        size, noise = scale.n_neighbors[pilot], scale.noise[pilot]
        return fit_rules(tree, x, known, Neighborhoods(centers, facing, size, noise))

    rules = rules_with(same)
    nearest = tree.query(rules.feet, 1, np.inf)[1][:, 0]
    rules = rules.facing(sides[nearest])
    wide = replace(rules, noise=ANY * rules.radius, residual=np.zeros(len(rules)))
    yield "+ fuzzy c-means, blended by distance", truth.error(infer_normals(wide, x)[0])
    yield "+ memberships in residual and quality", truth.error(infer_normals(rules, x)[0])
    error = truth.error(infer_normals(rules_with(sides), x, sides=sides)[0])
    yield "+ sides: global normals in typical data, fits, inference", error
    scale = refine_scale(x, tree, scale, sides, Limits())
    error = truth.error(infer_normals(rules_with(sides), x, sides=sides)[0])
    yield "+ scale refined with sides", error
    with (
        patch.object(pipeline, "shipped", lambda: None),
        patch.object(algorithm1, "leaned", lambda normals, *_: normals),
    ):
        with patch("o3d_sofnn.rules.growth.revise", lambda rules, *_: rules):
            error = cloud.error(pipeline.estimate_normals(cloud.points).normals)
            yield "+ growth, combination, adjustment, second fits", error
        error = cloud.error(pipeline.estimate_normals(cloud.points).normals)
        yield "+ third fits beside edges and other sheets", error
    with patch.object(algorithm1, "leaned", lambda normals, *_: normals):
        error = cloud.error(pipeline.estimate_normals(cloud.points).normals)
        yield "+ off-line rules", error
    error = cloud.error(pipeline.estimate_normals(cloud.points).normals)
    yield "+ leaning towards the winding number (the product)", error


def networks(cloud: Cloud, pairs: int) -> list[float]:
    """Return errors with the network, over that without it: as shipped, and learned on-line.

    On-line learning sees some pairs of a place and a rule, and is told how far the rule is from the
    normal inferred there, or from the true one, which nobody has.
    """
    found = lessons(cloud.points, cloud.normals, 2000)
    network = SOFNN().restore(shipped().network)

    def trust(some: object) -> Array:
        said = some.predict(found.inputs.reshape(-1, len(INPUTS)))  # type: ignore[attr-defined]
        return np.asarray(-EMPHASIS * said.reshape(found.memberships.shape))

    off_line = trust(network)
    membership = found.memberships + off_line
    share = np.exp(membership - membership.max(axis=1, keepdims=True))
    mean = np.einsum("pk,pkd->pd", share, found.normals)
    inferred = replace(found, truth=mean / np.linalg.norm(mean, axis=1, keepdims=True))
    errors = [found.error(off_line)]
    for teacher in (inferred, found):
        further = copy.deepcopy(network)
        further.max_rules = network.n_rules_
        further.partial_fit(*draw_pairs([teacher], pairs, np.random.default_rng(0)))
        errors.append(found.error(trust(further)))
    return [error / found.error(0.0) for error in errors]


if __name__ == "__main__":
    sys.exit(main())
