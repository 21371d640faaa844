"""Where rules are generated: at errors that neighbours share, not at the noise of single points."""

import numpy as np
from shapes import plane_patch

from o3d_sofnn._kernels import KdTree
from o3d_sofnn.rules.growth import ERROR, generate
from o3d_sofnn.rules.rule_base import fit_rules
from o3d_sofnn.sampling.local_fit import Neighborhoods

NOISE = 0.01


def rules_of_a_plane(points):
    """Few wide rules in the plane z = 0."""
    side = np.linspace(-0.4, 0.4, 4)
    centers = np.stack([*np.meshgrid(side, side), np.zeros((4, 4))], axis=-1).reshape(-1, 3)
    up = np.broadcast_to([0.0, 0.0, 1.0], centers.shape).copy()
    sides = np.broadcast_to([0.0, 0.0, 1.0], points.shape).copy()
    where = Neighborhoods(centers, up, np.full(16, 200), np.full(16, NOISE))
    return fit_rules(KdTree(points, 1), points, sides, where)


def test_single_points_off_the_surface_get_no_rules():
    points = plane_patch(4000).noisy(NOISE).points
    off = np.linspace(0, 3999, 40).astype(int)
    points[off, 2] += np.where(np.arange(40) % 2, 0.1, -0.1)
    centers, _, _ = generate(rules_of_a_plane(points), points, points[:, 2], KdTree(points, 1))
    assert len(centers) == 0


def test_points_that_are_off_together_get_rules():
    points = plane_patch(4000).noisy(NOISE).points
    bump = np.linalg.norm(points[:, :2], axis=1) < 0.08
    points[bump, 2] += 0.1
    rules = rules_of_a_plane(points)
    centers, count, noise = generate(rules, points, points[:, 2], KdTree(points, 1))
    assert len(centers) > 20
    assert (np.linalg.norm(centers[:, :2], axis=1) < 0.08).all()
    assert (np.abs(centers[:, 2]) > ERROR * rules.tolerance.min()).all()
    assert (count >= 12).all()
    assert len(count) == len(noise) == len(centers)
