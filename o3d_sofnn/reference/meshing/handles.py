"""Handles of a mesh by tree and cotree: twins of ``native/meshing/handles.hpp``."""

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


def _following(h: int) -> int:
    return h + 1 if h % 3 < 2 else h - 2


def _twins(triangles: Triangles) -> list[int]:
    """Twin of each half-edge: the one in the other direction."""
    start, end = triangles.ravel().tolist(), triangles[:, [1, 2, 0]].ravel().tolist()
    index = {pair: h for h, pair in enumerate(zip(start, end, strict=True))}
    return [index[b, a] for a, b in zip(start, end, strict=True)]


def handle_edges(vertices: Array, triangles: Triangles) -> NDArray[np.int32]:
    """Find two half-edges for each handle of a closed mesh (2 g,)."""
    start, end = triangles.ravel().tolist(), triangles[:, [1, 2, 0]].ravel().tolist()
    twin = _twins(triangles)
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
    return np.array([h for h in others if not sides.join(h // 3, twin[h] // 3)], np.int32)


def open_handles(
    vertices: Array, triangles: Triangles, edges: NDArray[np.int32], radius: Array, largest: int
) -> tuple[Array, Triangles, NDArray[np.int32], NDArray[np.uint8]]:
    """Cut short loops around the handles within a radius of half-edges, and close both sides.

    Returns
    -------
    vertices : (m + c, 3) float64
    triangles : (t + d, 3) int32
    source : (m + c,) int32
        The vertex that each one was, or is near to.
    touched : (m + c,) uint8
        1 for the vertices on cuts.
    """
    source = list(range(len(vertices)))
    touched: set[int] = set()
    for edge, reach in zip(edges.tolist(), radius.tolist(), strict=True):
        while len(loop := _short_loop(vertices, triangles, edge, reach, largest)):
            first = len(vertices)
            triangles, right = _cut(triangles, loop, first)
            middles = int(triangles.max()) + 1 - first - len(loop)
            lid = vertices[right].mean(axis=0)
            vertices = np.concatenate([vertices, vertices[right], np.tile(lid, (middles, 1))])
            source += [source[v] for v in right] + middles * [source[right[0]]]
            touched |= {*right, *range(first, len(vertices))}
    mask = np.zeros(len(vertices), np.uint8)
    mask[list(touched)] = 1
    return vertices, triangles, np.array(source, np.int32), mask


def _patch(
    vertices: Array, triangles: Triangles, edge: int, radius: float, largest: int
) -> list[int]:
    """Triangles that hang together with that of an edge, in a ball around its middle."""
    twin, corners = _twins(triangles), triangles.ravel()
    middle = vertices[corners[[edge, _following(edge)]]].mean(axis=0)
    inside = np.linalg.norm(vertices[triangles].mean(axis=1) - middle, axis=1) < radius
    rows = [edge // 3]
    for row in rows:
        for h in range(3 * row, 3 * row + 3):
            if inside[twin[h] // 3] and len(rows) < largest and twin[h] // 3 not in rows:
                rows.append(twin[h] // 3)
    return rows


def _cut(triangles: Triangles, loop: list[int], first: int) -> tuple[Triangles, list[int]]:
    """Cut along half-edges, with new vertices on the left; those on the right."""
    twin, cut = _twins(triangles), triangles.copy().ravel()
    right = triangles.ravel()[loop].tolist()
    left = [first + k for k in range(len(loop))]
    for k, h in enumerate(loop):
        while True:  # around the vertex on the left, from the edge ahead to the one behind
            cut[h] = left[k]
            behind = _following(_following(h))
            if behind == loop[k - 1]:
                break
            h = twin[behind]
    lids = []
    if len(loop) == 3:
        lids = [left[::-1], right]
    else:
        peak = first + len(loop)
        for k in range(len(loop)):
            after = (k + 1) % len(loop)
            lids += [[peak, left[after], left[k]], [peak + 1, right[k], right[after]]]
    return np.concatenate([cut.reshape(-1, 3), np.array(lids, np.int32)]), right


def _short_loop(
    vertices: Array, triangles: Triangles, edge: int, radius: float, largest: int
) -> list[int]:
    """Half-edges of a short loop that does not divide the patch around an edge."""
    rows = _patch(vertices, triangles, edge, radius, largest)
    halves = [h for row in rows for h in range(3 * row, 3 * row + 3)]
    local = {h: k for k, h in enumerate(halves)}
    twin = _twins(triangles)
    twins = [local.get(twin[h], -1) for h in halves]
    corner = Unions(len(halves))
    for h, g in enumerate(twins):
        if g >= 0:
            corner.join(h, _following(g))
            corner.join(_following(h), g)
    # A vertex at which the patch touches itself is a node for each side.
    roots = list(dict.fromkeys(corner.root(h) for h in range(len(halves))))
    number = {root: k for k, root in enumerate(roots)}
    node = [number[corner.root(h)] for h in range(len(halves))]
    name = triangles.ravel()[[halves[root] for root in roots]]
    border = Unions(len(roots))
    for h, g in enumerate(twins):
        if g < 0:
            border.join(node[h], node[_following(h)])
    chosen = [h for h, g in enumerate(twins) if g < 0 or h < g]
    edges = [(node[h], node[_following(h)]) for h in chosen]
    beside = [
        (h // 3, twins[h] // 3 if twins[h] >= 0 else len(rows) + border.root(node[h]))
        for h in chosen
    ]
    if len(roots) - len(edges) + len({side for pair in beside for side in pair}) == 2:
        return []
    place = vertices[name]
    length = [float(np.linalg.norm(place[a] - place[b])) for a, b in edges]
    half = {(node[h], node[_following(h)]): halves[h] for h in range(len(halves))}
    half |= {(b, a): twin[h] for (a, b), h in list(half.items())}
    best: list[int] = []
    least, root = np.inf, node[edge % 3]
    for _ in range(ROUNDS):
        distance, before = _paths(edges, length, len(roots), root)
        tree = {frozenset(pair) for pair in before.items()}
        others = [e for e, pair in enumerate(edges) if frozenset(pair) not in tree]
        others.sort(key=lambda e: -(distance[edges[e][0]] + distance[edges[e][1]] + length[e]))
        joined = Unions(len(rows) + len(roots))
        loops = [_close(*edges[e], before) for e in others if not joined.join(*beside[e])]
        better = False
        for loop in loops:
            along = float(np.linalg.norm(place[loop] - place[np.roll(loop, -1)], axis=1).sum())
            if len(set(name[loop].tolist())) == len(loop) and along < SHORTER * least:
                least, root, better = along, loop[len(loop) // 2], True
                best = [half[a, b] for a, b in zip(loop, loop[1:] + loop[:1], strict=True)]
        if not better:
            break
    return best


def _paths(
    edges: list[tuple[int, int]], length: list[float], count: int, root: int
) -> tuple[list[float], dict[int, int]]:
    """Distance of all nodes from one, and the node before each on the shortest path."""
    beside: list[list[tuple[int, float]]] = [[] for _ in range(count)]
    for (a, b), along in zip(edges, length, strict=True):
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
