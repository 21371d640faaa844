"""Stage 5: a model of the point density that scanners produce, fitted to find their positions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.orientation.visibility import Discs

Array = NDArray[np.float64]


GRAZING, POLE = 0.15, 0.1
"""Smallest cosines of incidence and of elevation in the model: no real density is infinite."""


STEPS, GONE = 30, 50.0
"""Largest number of steps of a fit, and distance from the scene, divided by its size, at which a
station is given up."""


NEAR = 1e-6
"""Smallest range, divided by the size of the scene."""


AXIS = np.array([0.0, 0.0, 1.0])
"""Axis about which scanners turn: their rays are densest near it."""


FOLLOWED, JOINED = 8, 3
"""Number of starts that are iterated to convergence, and of pairs extended by a third place."""


ROUGHLY = 5
"""Every so many-th place is used to choose the starts."""


@dataclass(frozen=True)
class Fit:
    """Stations, (k, 3), and the spread of the density that they leave unexplained."""

    stations: Array
    spread: float


@dataclass(frozen=True)
class Density:
    """Density of a cloud, and how well stations explain it.

    Attributes
    ----------
    places, normals : (p, 3) float64
        Places on the surface and unit normals of either sign.
    areas : (p,) float64
        Logarithm of the area that one point covers there.
    turning : bool
        Whether the scanners turn about the vertical.
    middle, size : (3,) float64 and float
        Median of the scene, and root mean square of the distances from it.
    """

    places: Array
    normals: Array
    areas: Array
    turning: bool
    middle: Array
    size: float

    @classmethod
    def of(cls, discs: Discs, turning: bool) -> Density:
        """Return the density at the discs."""
        middle = np.median(discs.places, axis=0)
        size = float(np.sqrt(((discs.places - middle) ** 2).sum(axis=1).mean()))
        return cls(discs.places, discs.normals, np.log(discs.areas), turning, middle, size)

    def starts(self) -> Array:
        """Return places around and within the scene, and beside the densest points."""
        grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
        ways = grid[np.abs(grid).sum(axis=1) > 0.0]
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        around = [self.middle + r * self.size * ways for r in (0.3, 0.8, 2.0, 5.0)]
        dense = np.argsort(self.areas)[: max(30, len(self.places) // 10)]
        apart = np.full(len(dense), np.inf)
        height = self.size * np.array([[-0.2], [-0.05], [0.05], [0.2]])
        beside = []
        for _ in range(8):
            row = dense[apart.argmax()]
            off = np.linalg.norm(self.places[dense] - self.places[row], axis=1)
            apart = np.minimum(apart, off)
            beside.append(self.places[row] + height * self.normals[row])
        return np.concatenate([self.middle[None], *around, *beside])

    def fits(self, count: int, known: list[Fit]) -> list[Fit]:
        """Fit the places of `count` stations, each fit from another start.

        A start is one place, a pair of places, or a known pair with a third place.
        """
        starts = self.starts()
        if count == 1:
            trials = starts[:, None]
        elif count == 2:
            trials = starts[np.stack(np.triu_indices(len(starts), 1), axis=1)]
        else:
            pairs = [fit.stations for fit in known[:JOINED]]
            trials = np.array([np.vstack([pair, start]) for pair in pairs for start in starts])
        order = np.argsort(self._thinned().spreads(trials), kind="stable")
        return [self.followed(trials[row]) for row in order[:FOLLOWED]]

    def errors(self, stations: Array) -> Array:
        """Return the logarithm of the area, divided by the area expected from (k, 3) stations."""
        return np.asarray(self.areas + np.log(sum(self._gain(place)[0] for place in stations)))

    def spread(self, stations: Array) -> float:
        """Return the spread of the errors."""
        return spread_of(self.errors(stations))

    def _thinned(self) -> Density:
        rows = slice(None, None, ROUGHLY)
        return replace(
            self, places=self.places[rows], normals=self.normals[rows], areas=self.areas[rows]
        )

    def spreads(self, trials: Array) -> Array:
        """Return the spread, (t,), that each of the trials, (t, k, 3), leaves."""
        places, index = np.unique(trials.reshape(-1, 3), axis=0, return_inverse=True)
        gains = np.array([self._gain(place)[0] for place in places])
        total = gains[index.reshape(trials.shape[:2])].sum(axis=1)
        errors = self.areas + np.log(total)
        middle = np.median(errors, axis=1, keepdims=True)
        return np.asarray(np.median(np.abs(errors - middle), axis=1))

    def slopes(self, stations: Array) -> Array:
        """Return the derivatives, (p, 3k), of the errors with respect to the stations."""
        gains, slopes = zip(*map(self._gain, stations), strict=True)
        total = np.sum(gains, axis=0)
        return np.hstack([(g / total)[:, None] * s for g, s in zip(gains, slopes, strict=True)])

    def _gain(self, place: Array) -> tuple[Array, Array]:
        """Return the density from a station, (p,), and the gradient of its logarithm, (p, 3)."""
        ray = self.places - place
        square = (ray**2).sum(axis=1) + (NEAR * self.size) ** 2
        gain = 1.0 / square
        slope = 2.0 * ray / square[:, None]
        share, slopes = _squared_cosine(ray, square, self.normals)
        gain, slope = (
            gain * np.sqrt(share + GRAZING**2),
            slope + (0.5 * slopes / (share + GRAZING**2)[:, None]),
        )
        if self.turning:
            share, slopes = _squared_cosine(ray, square, AXIS)
            rest = 1.0 - share + POLE**2
            gain, slope = gain / np.sqrt(rest), slope + 0.5 * slopes / rest[:, None]
        return gain, slope

    def followed(self, stations: Array) -> Fit:
        """Move the stations to minimise the spread, by Gauss-Newton with Tukey's weights."""
        errors = self.errors(stations)
        best, damping = spread_of(errors), 1e-2
        for _ in range(STEPS):
            if np.linalg.norm(stations - self.middle, axis=1).max() > GONE * self.size:
                break
            off = (errors - np.median(errors)) / (3.0 * max(best, 1e-9))
            weight = np.maximum(1.0 - off**2, 0.0) ** 2
            slopes = self.slopes(stations)
            slopes = slopes - weight @ slopes / weight.sum()
            rest = errors - weight @ errors / weight.sum()
            matrix = (slopes * weight[:, None]).T @ slopes
            downhill = -(weight * rest) @ slopes
            scale = np.diag(np.diag(matrix) + 1e-9 * np.trace(matrix))
            for _ in range(6):
                step = np.linalg.solve(matrix + damping * scale, downhill)
                new = self.errors(stations + step.reshape(-1, 3))
                if spread_of(new) < best:
                    break
                damping *= 5.0
            else:
                break
            stations, errors = stations + step.reshape(-1, 3), new
            before, best, damping = best, spread_of(new), 0.2 * damping
            if before - best < 1e-4 * before:
                break
        return Fit(stations, best)


def _squared_cosine(ray: Array, square: Array, normals: Array) -> tuple[Array, Array]:
    """Return the squared cosine between rays and normals, and its gradient in the rays' origin."""
    product = (ray * normals).sum(axis=1)
    cosine = product / square
    slopes = 2.0 * cosine[:, None] * (cosine[:, None] * ray - normals)
    return product * cosine, slopes


def spread_of(values: Array) -> float:
    """Return the median absolute deviation."""
    return float(np.median(np.abs(values - np.median(values))))
