"""Collapse of edges: twin of ``native/meshing/decimation.hpp``."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.reference.meshing.intersections import intersecting_pairs

Array = NDArray[np.float64]
Triangles = NDArray[np.int32]

BORDER, PLACE, TURN, SLIVER, MOST, AGAIN = 10.0, 1e-8, 0.2, 0.05, 48, 100
"""As in the kernel."""


def decimate(
    vertices: Array, triangles: Triangles, target: int
) -> tuple[Array, Triangles, NDArray[np.int32]]:
    """Collapse edges until a number of triangles is left, or none can be collapsed.

    Returns
    -------
    vertices : (v, 3) float64
    triangles : (k, 3) int32
    source : (v,) int32
        The vertex that each one was.
    """
    mesh = _Decimation(vertices, triangles)
    before = 2 * len(triangles)
    while len(mesh.triangles) > target and before - len(mesh.triangles) > before // AGAIN:
        before = len(mesh.triangles)
        for a, b in {(min(e), max(e)) for c in mesh.triangles.values() for e in _edges(c)}:
            mesh.push(a, b, "lowest")
        while len(mesh.triangles) > target and mesh.queue:
            entry = heapq.heappop(mesh.queue)
            if entry.ages == (mesh.age[entry.a], mesh.age[entry.b]):
                mesh.collapse(entry)
        mesh.queue = []
    left = np.array([mesh.triangles[t] for t in sorted(mesh.triangles)], np.int32)
    source, back = np.unique(left, return_inverse=True)
    return mesh.vertices[source], back.reshape(-1, 3).astype(np.int32), source.astype(np.int32)


class _Quadric(NamedTuple):
    """Weighted squared distances, ``x.A.x - 2 b.x + c``."""

    a: Array
    b: Array
    c: float

    def plus(self, other: _Quadric, weight: float = 1.0) -> _Quadric:
        a, b, c = self.a + weight * other.a, self.b + weight * other.b, self.c + weight * other.c
        return _Quadric(a, b, c)

    def at(self, x: Array) -> float:
        return float(x @ self.a @ x - 2.0 * self.b @ x + self.c)


class _Entry(NamedTuple):
    cost: float
    a: int
    b: int
    place: str
    ages: tuple[int, int]


def _edges(corners: list[int]) -> Iterator[tuple[int, int]]:
    yield from zip(corners, corners[1:] + corners[:1], strict=True)


def _plane(normal: Array, x: Array) -> _Quadric:
    far = float(normal @ x)
    return _Quadric(np.outer(normal, normal), far * normal, far**2)


class _Decimation:
    """Triangles by number, as they become fewer."""

    def __init__(self, vertices: Array, triangles: Triangles) -> None:
        self.vertices = vertices.copy()
        self.triangles: dict[int, list[int]] = dict(enumerate(triangles.tolist()))
        self.age = [0] * len(vertices)
        self.queue: list[_Entry] = []
        self.origin = vertices[0]
        self.quadrics = [_Quadric(np.zeros((3, 3)), np.zeros(3), 0.0) for _ in vertices]
        for corners in triangles.tolist():
            area = self.area_vector(corners)
            size, normal = float(np.linalg.norm(area)), unit(area[None])[0]
            for a, b in _edges(corners):
                x = vertices[a] - self.origin
                self.add(a, _plane(normal, x), size)
                self.add(a, _Quadric(np.eye(3), x, float(x @ x)), PLACE * size)
                if len(self.around(a) & self.around(b)) == 1:
                    edge = vertices[b] - vertices[a]
                    upright = _plane(unit(np.cross(edge, normal)[None])[0], x)
                    for end in (a, b):
                        self.add(end, upright, BORDER * float(edge @ edge))

    def add(self, vertex: int, quadric: _Quadric, weight: float) -> None:
        self.quadrics[vertex] = self.quadrics[vertex].plus(quadric, weight)

    def around(self, vertex: int) -> set[int]:
        return {t for t, corners in self.triangles.items() if vertex in corners}

    def neighbors(self, vertex: int) -> set[int]:
        return {v for t in self.around(vertex) for v in self.triangles[t]} - {vertex}

    def area_vector(self, corners: list[int]) -> Array:
        x = self.vertices[corners]
        return np.asarray(np.cross(x[1] - x[0], x[2] - x[0]) / 2.0)

    def place(self, a: int, b: int, place: str) -> Array:
        if place != "lowest":
            return np.asarray(self.vertices[a if place == "one end" else b])
        q = self.quadrics[a].plus(self.quadrics[b])
        return np.asarray(np.linalg.solve(q.a, q.b) + self.origin)

    def push(self, a: int, b: int, place: str) -> None:
        a, b = min(a, b), max(a, b)
        q = self.quadrics[a].plus(self.quadrics[b])
        cost = q.at(self.place(a, b, place) - self.origin)
        heapq.heappush(self.queue, _Entry(cost, a, b, place, (self.age[a], self.age[b])))

    def collapse(self, entry: _Entry) -> None:
        a, b = entry.a, entry.b
        if not self.keeps_topology(a, b):
            return
        gone = self.around(a) & self.around(b)
        changed = (self.around(a) | self.around(b)) - gone
        x = self.place(a, b, entry.place)
        after = self.vertices.copy()
        after[[a, b]] = x
        shape = len(changed) <= MOST and self.keeps_shape(after, sorted(changed))
        if not shape or not self.keeps_apart(after, gone, changed, a, b):
            if entry.place == "lowest":
                self.push(a, b, "one end")
                self.push(a, b, "other end")
            return
        self.quadrics[a] = self.quadrics[a].plus(self.quadrics[b])
        self.vertices[a] = x
        self.age[a] += 1
        self.age[b] += 1
        self.triangles = self.without(gone, a, b)
        for other in self.neighbors(a):
            self.push(a, other, "lowest")

    def without(self, gone: set[int], a: int, b: int) -> dict[int, list[int]]:
        return {
            t: [a if v == b else v for v in corners]
            for t, corners in self.triangles.items()
            if t not in gone
        }

    def keeps_topology(self, a: int, b: int) -> bool:
        """Whether what both ends see is what the edge sees."""
        gone = self.around(a) & self.around(b)
        border = [len(self.neighbors(v)) > len(self.around(v)) for v in (a, b)]
        rest = [{frozenset(self.triangles[t]) - {v} for t in self.around(v) - gone} for v in (a, b)]
        return (
            len(self.neighbors(a) & self.neighbors(b)) == len(gone)
            and not (all(border) and len(gone) == 2)
            and bool(rest[0] | rest[1])
            and not rest[0] & rest[1]
        )

    def keeps_shape(self, after: Array, changed: list[int]) -> bool:
        corners = np.array([self.triangles[t] for t in changed])
        area, shape = [], []
        for x in (self.vertices[corners], after[corners]):
            edges = np.roll(x, -1, axis=1) - x
            area.append(np.cross(edges[:, 0], edges[:, 1]))
            longest = (edges**2).sum(axis=2).max(axis=1)
            shape.append(np.linalg.norm(area[-1], axis=1) / longest)
        length = np.linalg.norm(area[0], axis=1) * np.linalg.norm(area[1], axis=1)
        turned = (area[0] * area[1]).sum(axis=1) < TURN * length
        return not (turned | (shape[1] < np.minimum(SLIVER, shape[0]))).any()

    def keeps_apart(self, after: Array, gone: set[int], changed: set[int], a: int, b: int) -> bool:
        left = self.without(gone, a, b)
        suspect = np.array([t in changed for t in left])
        return not len(intersecting_pairs(after, np.array(list(left.values()), np.int32), suspect))
