"""Flipped normals on generated shapes, and how often by confidence: ``python orientation.py``.

Sides are absolute: nothing is turned by hand.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.pipeline import estimate_normals

Array = NDArray[np.float64]


def ball(n: int, radius: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw points and outward normals of a sphere."""
    normals = rng.normal(size=(n, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return radius * normals, normals


def plate(n: int, thickness: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw points and outward normals of both faces and the rim of a square board of side 1."""
    size = np.array([1.0, 1.0, thickness])
    area = np.prod(size) / size
    axis, sign = rng.choice(3, n, p=area / area.sum()), rng.choice([-1.0, 1.0], n)
    row = np.arange(n)
    points, normals = rng.uniform(-0.5, 0.5, (n, 3)), np.zeros((n, 3))
    points[row, axis], normals[row, axis] = 0.5 * sign, sign
    return points * size, normals


def shapes(n: int, noise: float) -> Iterator[tuple[str, Array, Array]]:
    """Yield a name, clean points and outward normals of each shape."""
    rng = np.random.default_rng(0)
    spacing = np.sqrt(2.0 / n)
    thinnest = 2.0 * noise + 2.0 * spacing
    for factor in (1.0, 2.0, 4.0):
        points, normals = plate(n, factor * thinnest, rng)
        yield f"plate, {factor:g} x (2 noise + 2 spacings)", points, normals
    outer, inner = ball(n * 4 // 5, 0.5, rng), ball(n // 5, 0.25, rng)
    yield "hollow ball", np.r_[outer[0], inner[0]], np.r_[outer[1], -inner[1]]
    balls = [ball(n // 27, 0.12, rng) for _ in range(27)]
    centers = np.stack(np.meshgrid(*[[-0.35, 0.0, 0.35]] * 3), axis=-1).reshape(-1, 3)
    yield (
        "27 balls",
        np.concatenate([ball[0] + center for ball, center in zip(balls, centers, strict=True)]),
        np.concatenate([ball[1] for ball in balls]),
    )
    points, normals = ball(2 * n, 0.5, rng)
    low = points[:, 2] < 0.0
    yield "open cup", points[low], normals[low]
    x, y = rng.uniform(-0.5, 0.5, (2, n))
    slope = np.stack([-0.6 * np.cos(12.0 * x), np.zeros(n), np.ones(n)], axis=1)
    points = np.stack([x, y, 0.05 * np.sin(12.0 * x)], axis=1)
    yield "waves (open)", points, slope / np.linalg.norm(slope, axis=1, keepdims=True)


LEVELS = (0.0, 0.005, 0.01)
"""Of noise, in units of the size."""


def main() -> int:
    """Print both tables; 0, 1 when a shape failed, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=20_000, help="points of each shape")
    parser.add_argument("--quick", action="store_true", help="1,500 points of each shape")
    options = parser.parse_args()
    count = 1500 if options.quick else options.n
    code = 0
    confidence, wrong = [np.zeros(0)], [np.zeros(0, bool)]
    rows: dict[str, list[str]] = {}
    said: dict[str, str] = {}
    try:
        for level in LEVELS:
            for name, points, normals in shapes(count, level):
                print(f"{name}, noise {100 * level:g} %", file=sys.stderr, flush=True)
                noise = np.random.default_rng(1).normal(0.0, level, points.shape)
                try:
                    found = estimate_normals(points + noise)
                except (ValueError, MemoryError) as error:  # the other shapes go on
                    print(f"  failed: {error}", file=sys.stderr)
                    rows.setdefault(name, []).append("failed")
                    code = 1
                    continue
                flipped = (found.normals * normals).sum(axis=1) < 0.0
                rows.setdefault(name, []).append(f"{100 * flipped.mean():.2f}")
                said[name] = "yes" if found.warnings else ""
                confidence.append(found.confidence[found.confidence > 0.0])
                wrong.append(flipped[found.confidence > 0.0])
    except KeyboardInterrupt:
        code = 130
        print("interrupted; this is what was finished", file=sys.stderr)
    print_tables(rows, said, np.concatenate(confidence), np.concatenate(wrong))
    return code


def print_tables(
    rows: dict[str, list[str]], said: dict[str, str], confidence: Array, wrong: NDArray[np.bool_]
) -> None:
    """Print the flipped share by shape and noise, and by tenth of the confidence."""
    titles = [f"noise {100 * level:g} %" for level in LEVELS]
    print("| shape | " + " | ".join(titles) + " | warning |")
    print("|---" * (len(LEVELS) + 2) + "|")
    for name, cells in rows.items():
        cells = cells + [""] * (len(LEVELS) - len(cells))
        print(f"| {name} | " + " | ".join(cells) + f" | {said.get(name, '')} |")
    if len(wrong) < 10:
        return
    order = np.argsort(confidence, kind="stable")
    tenths = np.array_split(wrong[order], 10)
    print("\nFlipped, % of each tenth of the points, least confident first:")
    print(", ".join(f"{100 * tenth.mean():.2f}" for tenth in tenths))


if __name__ == "__main__":
    sys.exit(main())
