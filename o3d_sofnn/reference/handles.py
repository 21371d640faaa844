"""Handles of a mesh by tree and cotree: twins of ``native/handles.hpp``."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Triangles = NDArray[np.int32]
ROUNDS = 3
SHORTER = 1 - 1e-9


class Unions:
    """Sets of numbers that grow together."""

    def __init__(self, n: int) -> None:
        self.parent = list(range(n))

    def root(self, i: int) -> int:
        """Least number of the set."""
        while self.parent[i] != i:
            i = self.parent[i]
        return i

    def join(self, a: int, b: int) -> bool:
        """Join two sets; False where they are one already."""
        a, b = self.root(a), self.root(b)
        self.parent[max(a, b)] = min(a, b)
        return a != b


def _half_edges(triangles: Triangles) -> tuple[list[int], list[int], list[int]]:
    """Start and end of each half-edge, and its twin or -1."""
    start = triangles.ravel().tolist()
    end = triangles[:, [1, 2, 0]].ravel().tolist()
    index = {pair: h for h, pair in enumerate(zip(start, end, strict=True))}
    twin = [index.get((b, a), -1) for a, b in zip(start, end, strict=True)]
    return start, end, twin


def handle_edges(vertices: Array, triangles: Triangles) -> Triangles:
    """Find two edges for each handle of a closed mesh (2 g, 2)."""
    start, end, twin = _half_edges(triangles)
    leaving: list[list[int]] = [[] for _ in vertices]
    for h, a in enumerate(start):
        leaving[a].append(h)
    depth = [-1] * len(vertices)
    tree: set[int] = set()
    for first in range(len(vertices)):
        if depth[first] >= 0:
            continue
        depth[first] = 0
        queue = [first]
        for vertex in queue:
            for h in leaving[vertex]:
                if depth[end[h]] < 0:
                    depth[end[h]] = depth[vertex] + 1
                    queue.append(end[h])
                    tree |= {h, twin[h]}
    others = [h for h in range(len(start)) if h < twin[h] and h not in tree]
    others.sort(key=lambda h: -(depth[start[h]] + depth[end[h]]))
    sides = Unions(len(triangles))
    found = [(start[h], end[h]) for h in others if not sides.join(h // 3, twin[h] // 3)]
    return np.array(found, np.int32).reshape(-1, 2)


def short_loop(vertices: Array, triangles: Triangles, first: int, second: int) -> NDArray[np.int32]:
    """Find a short loop that does not divide the patch of triangles around an edge, (k,)."""
    none = np.zeros(0, np.int32)
    start, end, twin = _half_edges(triangles)
    if (first, second) not in zip(start, end, strict=True):
        return none
    corner, piece = Unions(len(start)), Unions(len(triangles))
    for h, g in enumerate(twin):
        if g >= 0:
            corner.join(h, g + 1 if g % 3 < 2 else g - 2)
            corner.join(h + 1 if h % 3 < 2 else h - 2, g)
            piece.join(h // 3, g // 3)
    seed = piece.root(list(zip(start, end, strict=True)).index((first, second)) // 3)
    inner = [h for h in range(len(start)) if piece.root(h // 3) == seed]
    # A vertex at which the patch touches itself is a node for each side.
    roots = list(dict.fromkeys(corner.root(h) for h in inner))
    number = {root: k for k, root in enumerate(roots)}
    node = {h: number[corner.root(h)] for h in inner}
    name = triangles.ravel()[roots]
    after = {h: node[h + 1 if h % 3 < 2 else h - 2] for h in inner}
    border = Unions(len(roots))
    for h in inner:
        if twin[h] < 0:
            border.join(node[h], after[h])
    edges = [
        (node[h], after[h], h // 3, twin[h] // 3 if twin[h] >= 0 else -1 - border.root(node[h]))
        for h in inner
        if twin[h] < 0 or h < twin[h]
    ]
    sides = list({side for edge in edges for side in edge[2:]})
    if len(roots) - len(edges) + len(sides) == 2:
        return none
    place = vertices[name]
    length = [float(np.linalg.norm(place[a] - place[b])) for a, b, _, _ in edges]
    row = {side: k for k, side in enumerate(sides)}
    best, least = none, np.inf
    root = node[3 * (list(zip(start, end, strict=True)).index((first, second)) // 3)]
    for _ in range(ROUNDS):
        distance, before = _paths(edges, length, len(roots), root)
        tree = {frozenset(pair) for pair in before.items()}
        others = [e for e, edge in enumerate(edges) if frozenset(edge[:2]) not in tree]
        others.sort(key=lambda e: -(distance[edges[e][0]] + distance[edges[e][1]] + length[e]))
        joined, loops = Unions(len(sides)), []
        for e in others:
            if not joined.join(row[edges[e][2]], row[edges[e][3]]):
                loops.append(_close(edges[e][0], edges[e][1], before))
        better = False
        for loop in loops:
            along = float(np.linalg.norm(place[loop] - place[np.roll(loop, -1)], axis=1).sum())
            if len(set(name[loop].tolist())) == len(loop) and along < SHORTER * least:
                least, best, root, better = along, name[loop], loop[len(loop) // 2], True
        if not better:
            break
    return np.asarray(best, np.int32)


def _paths(
    edges: list[tuple[int, int, int, int]], length: list[float], count: int, root: int
) -> tuple[list[float], dict[int, int]]:
    """Distance of all nodes from one, and the node before each on the shortest path."""
    beside: list[list[tuple[int, float]]] = [[] for _ in range(count)]
    for (a, b, _, _), along in zip(edges, length, strict=True):
        beside[a].append((b, along))
        beside[b].append((a, along))
    distance = [np.inf] * count
    distance[root] = 0.0
    before: dict[int, int] = {}
    queue = [(0.0, root)]
    while queue:
        reached, node = heapq.heappop(queue)
        for other, along in beside[node] if reached <= distance[node] else []:
            if reached + along < distance[other]:
                distance[other], before[other] = reached + along, node
                heapq.heappush(queue, (distance[other], other))
    return distance, before


def _close(a: int, b: int, before: dict[int, int]) -> list[int]:
    """Loop of the edge from a to b and the paths to both, without what they have in common."""
    one, other = [a], [b]
    for path in (one, other):
        while path[-1] in before:
            path.append(before[path[-1]])
    while len(one) > 1 and len(other) > 1 and one[-2] == other[-2]:
        one.pop()
        other.pop()
    return one + other[-2::-1]
