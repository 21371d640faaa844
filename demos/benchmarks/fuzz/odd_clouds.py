"""Odd clouds and options from a seed: nobody means to reconstruct them, but files hold them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Random = np.random.Generator

MOST = 600
"""Points of the largest cloud: a call then takes a tenth of a second."""


class Case(NamedTuple):
    """One call of an operator."""

    kind: str
    points: Array
    surface: bool
    options: dict[str, Any]


def case(seed: int) -> Case:
    """Draw a call.

    Parameters
    ----------
    seed : int
        The same seed gives the same call.

    Returns
    -------
    Case
    """
    rng = np.random.default_rng(seed)
    kind = list(KINDS)[int(rng.integers(len(KINDS)))]
    points = _spoiled(KINDS[kind](rng), rng)
    surface = bool(rng.random() < 0.6)
    return Case(kind, np.ascontiguousarray(points), surface, _options(points, surface, rng))


def lattice(*shape: int) -> Array:
    """Integer grid, (n, 3)."""
    axes = np.meshgrid(*map(np.arange, shape), indexing="ij")
    return np.stack(axes, axis=-1).reshape(-1, 3).astype(np.float64)


def sphere(n: int, rng: Random) -> Array:
    """Points on the unit sphere, (n, 3)."""
    x = rng.normal(size=(n, 3))
    return np.asarray(x / np.linalg.norm(x, axis=1, keepdims=True))


def _count(rng: Random) -> int:
    """Draw a number of points, small ones as often as large ones."""
    return int(np.exp(rng.uniform(np.log(13), np.log(MOST))))


def _solid(rng: Random) -> Array:
    a, b, c = rng.integers(2, 9, 3)
    return lattice(a, b, c)


def _cube(rng: Random) -> Array:
    return lattice(*[int(rng.integers(4, 9))] * 3)


def _shell(rng: Random) -> Array:
    """Outside of a lattice, or the voxels that a sphere meets."""
    n = int(rng.integers(3, 10))
    x = lattice(n, n, n)
    if rng.random() < 0.5:
        return x[((x == 0) | (x == n - 1)).any(axis=1)]
    return x[np.abs(np.linalg.norm(x - 0.5 * (n - 1), axis=1) - 0.45 * n) < 0.6]


def _planes(rng: Random) -> Array:
    """One lattice in a plane, or some above each other."""
    n = int(rng.integers(3, 13))
    x = lattice(n, n, int(rng.integers(1, 4)))[:MOST]
    return x * [1.0, 1.0, 10.0 ** rng.uniform(-3.0, 1.0)]


def _flat(rng: Random) -> Array:
    thick = rng.choice([0.0, 1e-300, 1e-12, 1e-6, 1e-3])
    return rng.uniform(-1.0, 1.0, (_count(rng), 3)) * [1.0, 1.0, thick]


def _few(rng: Random) -> Array:
    x = rng.normal(size=(int(rng.integers(4, 13)), 3))
    return np.rint(x) if rng.random() < 0.3 else x


def _ball(rng: Random) -> Array:
    """Points all over a volume."""
    n = _count(rng)
    return rng.normal(size=(n, 3)) if rng.random() < 0.5 else rng.uniform(-1.0, 1.0, (n, 3))


def _lines(rng: Random) -> Array:
    """One to four straight lines, perhaps with something beside them."""
    t = rng.uniform(-1.0, 1.0, (int(rng.integers(1, 5)), _count(rng) // 4 + 2, 1))
    x = (t * rng.normal(size=(len(t), 1, 3)) + rng.normal(size=(len(t), 1, 3))).reshape(-1, 3)
    return np.concatenate([x, rng.normal(size=(int(rng.integers(0, 4)), 3))])


def _curve(rng: Random) -> Array:
    t = np.sort(rng.uniform(0.0, 1.0, _count(rng)))
    return np.stack([np.cos(9.0 * t), np.sin(9.0 * t), 3.0 * t], axis=1)


def _round(rng: Random) -> Array:
    return sphere(_count(rng), rng) * rng.choice([1.0, 0.1, 1.0 / 3.0], 3)


def _noisy(rng: Random) -> Array:
    x = _round(rng)
    return x + 10.0 ** rng.uniform(-3.0, 0.0) * rng.normal(size=x.shape)


def _sheets(rng: Random) -> Array:
    """Two parallel sheets, and how far apart."""
    x = rng.uniform(-1.0, 1.0, (_count(rng), 3))
    x[:, 2] = np.where(np.arange(len(x)) % 2, 10.0 ** rng.uniform(-9.0, 0.0), 0.0)
    return x


def _parts(rng: Random) -> Array:
    """Two shapes, how far apart, and how much smaller one of them is."""
    one, other = _round(rng)[: MOST // 2], _round(rng)[: MOST // 2]
    away, small = 10.0 ** rng.uniform(-1.0, 14.0), 10.0 ** rng.uniform(-14.0, 1.0)
    return np.concatenate([one, small * other + [away, 0.0, 0.0]])


def _spots(rng: Random) -> Array:
    """Crowd points in one or a few places of a shape."""
    x = _round(rng)
    places = x[rng.integers(0, len(x), int(rng.integers(1, 4)))]
    n = int(rng.integers(5, 200))
    size = 10.0 ** rng.uniform(-17.0, -3.0)
    return np.concatenate(
        [x, places[rng.integers(0, len(places), n)] + size * rng.normal(size=(n, 3))]
    )


def _corners(rng: Random) -> Array:
    jitter = 10.0 ** rng.uniform(-17.0, -1.0)
    x = np.repeat(lattice(2, 2, 2), int(rng.integers(1, 9)), axis=0)
    return x + jitter * rng.normal(size=x.shape)


def _mixed(rng: Random) -> Array:
    """Parts of several kinds, each in a place of its own."""
    makers = [_solid, _planes, _lines, _round, _ball, _few]
    chosen = [makers[i] for i in rng.integers(0, len(makers), int(rng.integers(2, 4)))]
    parts = [make(rng)[: MOST // len(chosen)] for make in chosen]
    return np.concatenate([part + 5.0 * rng.normal(size=3) for part in parts])


def _step(rng: Random) -> Array:
    """Round a shape to the grid that a format with few digits leaves."""
    step = 10.0 ** rng.uniform(-3.0, -0.3)
    return np.rint(_round(rng) / step) * step


KINDS: dict[str, Callable[[Random], Array]] = {
    "lattice cube": _cube,
    "lattice block": _solid,
    "voxel shell": _shell,
    "lattice planes": _planes,
    "flat": _flat,
    "4 to 12 points": _few,
    "volume": _ball,
    "lines": _lines,
    "curve": _curve,
    "round": _round,
    "noisy": _noisy,
    "two sheets": _sheets,
    "parts far apart": _parts,
    "dense spots": _spots,
    "corners with jitter": _corners,
    "mixed": _mixed,
    "few digits": _step,
}
"""Kinds of clouds by name."""


def _spoiled(x: Array, rng: Random) -> Array:
    """Do one or two of the things to a cloud that happen to files."""
    for what in rng.choice(9, int(rng.integers(0, 3)), replace=False):
        n = len(x)
        if what == 0:  # repeated points
            x = np.concatenate([x, x[rng.integers(0, n, int(rng.integers(1, n + 1)))]])[:MOST]
        elif what == 1:
            x = x * 10.0 ** rng.uniform(-55.0, 55.0)
        elif what == 2:  # squashed
            x = x * 10.0 ** rng.uniform(rng.choice([-320.0, -12.0, -3.0]), 0.0, 3)
        elif what == 3:  # far from the origin
            x = x + 10.0 ** rng.uniform(0.0, 17.0) * rng.normal(size=3)
        elif what == 4:  # outliers
            far = 10.0 ** rng.uniform(0.0, 20.0) * rng.normal(size=(int(rng.integers(1, 6)), 3))
            x = np.concatenate([x, far])
        elif what == 5:  # one far corner, as rows of zeros among map coordinates
            x = np.concatenate(
                [x + np.array([5e5, 4.9e6, 200.0]), np.zeros((int(rng.integers(1, 4)), 3))]
            )
        elif what == 6:
            x = x @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
        elif what == 7:  # eight digits
            x = rng.permutation(x)
            digits = np.abs(x).max() * 2.0**-24
            x = np.rint(x / digits) * digits
        elif rng.random() < 0.2:  # rows without coordinates, and nothing after that
            return np.where(rng.random((n, 1)) < 0.05, rng.choice([np.nan, np.inf]), x)
    return x


def _options(x: Array, surface: bool, rng: Random) -> dict[str, Any]:
    """Draw options, mostly none."""
    finite = x[np.isfinite(x).all(axis=1)]
    size = float(np.ptp(finite, axis=0).max(initial=0.0)) or 1.0
    drawn: dict[str, Any] = {
        "max_nn": int(rng.choice([6, 10, 40, 10**6])),
        "radius": size * 10.0 ** rng.uniform(-6.0, 2.0),
        "n_threads": int(rng.integers(1, 4)),
    }
    drawn |= (
        {"viewpoint": size * 10.0 ** rng.uniform(-2.0, 3.0) * rng.normal(size=3)}
        if rng.random() < 0.5
        else {"towards": np.eye(3)[int(rng.integers(3))]}
    )
    if surface:
        drawn["trim"] = "auto" if rng.random() < 0.5 else float(rng.random())
        drawn["target_triangles"] = int(rng.choice([4, 20, 200, 2000]))
        drawn["precision"] = size * 10.0 ** rng.uniform(-9.0, 1.0)
        drawn |= (
            {"depth": int(rng.integers(1, 7))}
            if rng.random() < 0.5
            else {"voxel_size": size * 10.0 ** rng.uniform(-1.8, 1.0)}
        )
    return {name: value for name, value in drawn.items() if rng.random() < 0.2}
