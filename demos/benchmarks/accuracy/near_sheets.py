"""Sides, pieces and genus of generated sheets close to each other: ``python near_sheets.py``.

Gaps are in spacings of the points (edge of the square that one point covers). Closed thin solids: a
plate, flat, rolled a little and much. Pairs of solids: two boards, and a ball within a hollow one.
Sides are absolute: nothing is turned by hand.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from topology import shape

from o3d_sofnn.pipeline import estimate_normals, reconstruct_surface

Array = NDArray[np.float64]
Drawn = tuple[Array, Array]


def board(n: int, size: Array, rng: np.random.Generator) -> Drawn:
    """Draw points and outward normals of a box."""
    area = np.prod(size) / size
    axis, sign = rng.choice(3, n, p=area / area.sum()), rng.choice([-1.0, 1.0], n)
    points, normals = rng.uniform(-0.5, 0.5, (n, 3)), np.zeros((n, 3))
    points[np.arange(n), axis], normals[np.arange(n), axis] = 0.5 * sign, sign
    return points * size, normals


def ball(n: int, radius: float, rng: np.random.Generator) -> Drawn:
    """Draw points and outward normals of a sphere."""
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return radius * normals, normals


def bent(drawn: Drawn, curvature: float) -> Drawn:
    """Roll a board around a cylinder, which keeps its thickness and the spacing of its middle."""
    points, normals = drawn
    angle, radius = curvature * points[:, 0], 1.0 / curvature + points[:, 2]
    sine, cosine = np.sin(angle), np.cos(angle)
    places = np.stack([radius * sine, points[:, 1], radius * cosine], axis=1)
    across, _, up = normals.T
    turned = np.stack(
        [cosine * across + sine * up, normals[:, 1], cosine * up - sine * across], axis=1
    )
    return places, turned


def plate(n: int, gap: float, rng: np.random.Generator) -> Drawn:
    """Draw a thin plate."""
    return board(n, np.array([1.0, 1.0, gap * np.sqrt(2.0 / n)]), rng)


def rolled(n: int, gap: float, rng: np.random.Generator) -> Drawn:
    """Draw a plate rolled by a radian."""
    return bent(plate(n, gap, rng), 1.0)


def half_pipe(n: int, gap: float, rng: np.random.Generator) -> Drawn:
    """Draw a plate rolled by half a turn."""
    return bent(plate(n, gap, rng), np.pi)


def boards(n: int, gap: float, rng: np.random.Generator) -> Drawn:
    """Draw two thick boards whose faces are close to each other."""
    size = np.array([1.0, 1.0, 0.4])
    spacing = np.sqrt(2.0 * 3.6 / n)
    below, above = board(n // 2, size, rng), board(n - n // 2, size, rng)
    up = np.array([0.0, 0.0, size[2] + gap * spacing])
    return np.concatenate([below[0], above[0] + up]), np.concatenate([below[1], above[1]])


def nested(n: int, gap: float, rng: np.random.Generator) -> Drawn:
    """Draw a ball within a hollow ball whose inner wall is close to it."""
    radii = np.array([0.4, 0.4 + gap * 0.02, 0.6])
    share = radii**2 / (radii**2).sum()
    spacing = np.sqrt(4.0 * np.pi * (radii**2).sum() / n)
    radii[1] = radii[0] + gap * spacing
    counts = np.round(share * n).astype(int)
    drawn = [ball(count, r, rng) for count, r in zip(counts, radii, strict=True)]
    points, normals = (np.concatenate(parts) for parts in zip(*drawn, strict=True))
    normals[counts[0] : counts[0] + counts[1]] *= -1.0
    return points, normals


KINDS: dict[str, tuple[Callable[[int, float, np.random.Generator], Drawn], int]] = {
    "plate": (plate, 1),
    "rolled": (rolled, 1),
    "half pipe": (half_pipe, 1),
    "boards": (boards, 2),
    "nested balls": (nested, 3),
}
"""What is drawn, and the pieces of its surface; the genus of all is 0."""


def main() -> int:
    """Print a line for each kind and gap: the worst and the mean of the seeds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=4000, help="points (default: %(default)s)")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--gaps", type=float, nargs="+", default=[1.0, 1.5, 2.0, 3.0])
    parser.add_argument("--noise", type=float, default=0.0, help="in spacings")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--meshes", action="store_true", help="pieces and genus, too")
    options = parser.parse_args()
    print("| kind | gap, spacings | flipped, % | worst | warnings | pieces, genus (truth) |")
    print("|---|---|---|---|---|---|")
    for kind in options.kinds:
        make, pieces = KINDS[kind]
        for gap in options.gaps:
            flipped, warned, found = [], 0, []
            for seed in options.seeds:
                rng = np.random.default_rng(seed)
                points, normals = make(options.n, gap, rng)
                if options.noise:
                    spacing = estimate_normals(points).spacing
                    points = points + rng.normal(0.0, options.noise * spacing, points.shape)
                if options.meshes:
                    surface = reconstruct_surface(points, closed=True)
                    found.append("{}, {}".format(*shape(surface.vertices, surface.triangles)))
                    estimate = surface.normals
                else:
                    estimate = estimate_normals(points)
                wrong = (estimate.normals * normals).sum(axis=1) <= 0.0
                flipped.append(100.0 * wrong.mean())
                warned += bool(estimate.warnings)
            said = "; ".join(found) + f" ({pieces}, 0)" if found else ""
            print(
                f"| {kind} | {gap:g} | {np.mean(flipped):.2f} | {max(flipped):.2f} | {warned} "
                f"| {said} |",
                flush=True,
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
