"""Native kernels: the loops over points, rules, cells and grid nodes.

Arrays are C-contiguous and on the host: float64 but for the int64 counts and offsets. Kernels check
types, shapes, lengths and indices: a ValueError that names the argument. Coordinates of about unit
size give finite results whatever else they are; others and what is no number, results without
meaning. Kernels release the GIL, have no global state, and their results do not depend on
``n_threads``; where the system gives fewer threads they do with those, and memory that is missing
in any of them is a MemoryError. :mod:`o3d_sofnn.reference` has a slow twin of each.
"""

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]

class KdTree:
    """Tree over points (n, 3), which are copied.

    Parameters
    ----------
    points : (n, 3) float64
    n_threads : int
    """

    def __init__(self, points: _Floats, n_threads: int) -> None: ...
    @property
    def size(self) -> int:
        """Number of points."""

    def query(
        self, x: _Floats, k: int, max_distance: float, n_threads: int
    ) -> tuple[_Floats, _Ints]:
        """Find the `k` nearest points of every row of `x` within `max_distance`.

        Returns distances and indices, (m, k) each, nearest first, of equally near ones the smaller
        index first. Infinity and ``size`` fill rows with fewer neighbours.
        """

    def crowded(self, x: _Floats, k: int, distance: _Floats, n_threads: int) -> NDArray[np.uint8]:
        """Whether (1 or 0) each row of `x` has at least `k` points within its `distance` (m,)."""

def sort_morton(points: _Floats, n_threads: int) -> tuple[NDArray[np.uint64], _Ints]:
    """Sort points (n, 3) along the Morton curve, 21 bits an axis.

    Returns ascending keys (n,) and the row (n,) that each comes from, of equal keys the smaller row
    first.
    """

def fit_scales(
    tree: KdTree, points: _Floats, centers: _Floats, scales: _Ints, n_threads: int
) -> tuple[_Floats, _Floats, _Floats, _Floats]:
    """Fit quadrics around `centers` (m, 3) to the nearest `scales` (s,) points, ascending.

    Returns unit normals (m, s, 3) of either sign, and, each (m, s), residual (root mean square),
    radius and surface variation.
    """

def fit_quadrics(
    tree: KdTree,
    points: _Floats,
    centers: _Floats,
    n_neighbors: _Ints,
    robust: _Floats,
    iterations: int,
    normals: _Floats | None,
    sides: _Floats | None,
    across: _Floats | None,
    stretch: _Floats,
    n_threads: int,
) -> tuple[_Floats, _Floats, _Floats, _Floats, _Floats]:
    """Fit one quadric around each centre, to its own number of neighbours (r,).

    `robust` (r,) is the width of a residual weight that is iterated, 0 for none; with `normals`
    (n, 3) and `sides` (r, 3) points that face away from their rule do not count; with `across`
    (r, 3), tangents of the sides, neighbourhoods are ellipses that are narrow along these, and
    `stretch` (r,) times longer than wide.

    Returns frames (r, 3, 3) with rows tangent, tangent, normal, coefficients (r, 6) of
    ``h = c0 + c1 u + c2 v + c3 u^2 + c4 uv + c5 v^2`` with lengths divided by the radius, and, each
    (r,), residual, radius, and the share of the neighbourhood that faces the side.
    """

class RuleView:
    """The arrays of a rule base, copied, and a tree over its centres.

    Parameters
    ----------
    centers : (r, 3) float64
    frames : (r, 3, 3) float64
    coefficients : (r, 6) float64
    radius, stretch, tolerance, quality : (r,) float64
    gates : (r, m, 2) float64 or None
        Share of each rule in at most 8 neurons of the off-line rules: logarithm of the firing
        strength and consequent, as far as the inputs belong to the rule.
    neurons : (m, 3, 3) float64 or None
        Centres, inverse widths and slopes by the inputs that belong to the place.
    n_threads : int
    """

    def __init__(
        self,
        centers: _Floats,
        frames: _Floats,
        coefficients: _Floats,
        radius: _Floats,
        stretch: _Floats,
        tolerance: _Floats,
        quality: _Floats,
        gates: _Floats | None,
        neurons: _Floats | None,
        n_threads: int,
    ) -> None: ...
    @property
    def size(self) -> int:
        """Number of rules."""

def infer_normals(
    rules: RuleView, x: _Floats, sides: _Floats | None, k: int, n_threads: int
) -> tuple[_Floats, _Floats, _Floats]:
    """Infer a normal at every row of `x` from the `k` nearest rules, eq. (7) and (9).

    Rules that face the way of `sides` (m, 3), unit vectors or zero, have a larger share. Returns
    unit normals (m, 3), agreement of the rules (m,) and residual to the best one (m,). Fastest
    where consecutive places lie close together.
    """

def reconstruct_units(
    tree: KdTree,
    points: _Floats,
    normals: _Floats,
    rules: RuleView,
    n_neighbors: _Ints,
    n_own: _Ints,
    tolerance: _Floats,
    n_threads: int,
) -> tuple[_Floats, _Ints, _Floats, _Floats]:
    """Refine the quadric of every rule until its points are met, Algorithm 2.

    `tree` is over `points`, `tolerance` (r,) is the precision, `n_own` of the `n_neighbors` points
    of a unit decide whether it is refined. Returns basis functions (r, t, 4) as centre and weight,
    the number of them in use (r,), the largest residual left (r,), and where it is (r, 3).
    """

def evaluate_field(
    rules: RuleView, rbf: _Floats, terms: _Ints, x: _Floats, k: int, n_threads: int
) -> _Floats:
    """Signed distance (m,) at every row of `x`, blended from the `k` nearest rules, eq. (9).

    `rbf` and `terms` come from :func:`reconstruct_units`.
    """

def consequent_errors(
    rules: RuleView, x: _Floats, k: int, n_threads: int
) -> tuple[_Floats, _Floats]:
    """Sum output, eq. (7), times fuzzy basis function, eq. (9), of each rule over `x` (m, 3).

    Only the `k` nearest rules of a place take part. Returns that sum and that of the basis
    functions alone, (r,) each.
    """

def typical_data(
    points: _Floats,
    offsets: _Ints,
    n_clusters: _Ints,
    iterations: int,
    tolerance: float,
    n_threads: int,
) -> _Floats:
    """Fuzzy c-means in every cell ``points[offsets[i]:offsets[i + 1]]``, eq. (1) to (6).

    Returns centres (sum of `n_clusters`, 3), cell by cell.
    """

class WindingLists:
    """Places, and what a tree sums there."""

def divide_cells(normals: _Floats, first: _Ints, n_threads: int) -> tuple[_Ints, _Ints]:
    """Divide the cells ``normals[first[i]:first[i + 1]]`` of unit normals by their side.

    Returns rows (n,), the part that faces the way of the first row at the head of each cell, and
    how many that part has (c,).
    """

class DualWalk:
    """Walk over the dual cubes of a balanced octree, from those at `points` (n, 3) on.

    Leaves around a point have edges of at most ``size * 2**level``, the largest ``size * 2**top``.
    A leaf has its middle as its key, in half cells from `origin`, 21 bits a coordinate.
    """

    def __init__(
        self,
        points: _Floats,
        origin: _Floats,
        size: float,
        levels: _Ints,
        top: int,
        n_threads: int,
    ) -> None: ...
    def advance(self, inside: NDArray[np.bool_]) -> _Ints:
        """Take the signs of the leaves that were wanted last; return those wanted next.

        None are wanted when the surface of the function has closed.
        """

    def leaves(self) -> _Ints:
        """Return all leaves that were wanted, (m,)."""

    def take_crossed(self) -> NDArray[np.int32]:
        """Return the leaves at the corners of the cubes with a change of sign, (c, 8), once."""

def marching_cubes(
    values: _Floats,
    nodes: _Floats,
    cubes: NDArray[np.int32],
    triangles: _Ints,
    members: _Ints,
    ends: _Ints,
    nudges: _Floats,
) -> tuple[_Floats, NDArray[np.int32], NDArray[np.int32], _Floats]:
    """Triangulate the zero set of `values` (m,) at `nodes` (m, 3) on `cubes` (c, 8).

    Tables as :func:`o3d_sofnn.meshing.marching_cubes.both_tables` gives them. Vertices stay away
    from the nodes by ``nudges[0]`` of the edge. Returns vertices (v, 3), outward triangles (t, 3),
    the vertices (k,) beside cubes with corners that coincide and their places (k, 3) ``nudges[1]``
    away.
    """

def vertex_normals(vertices: _Floats, triangles: NDArray[np.int32]) -> _Floats:
    """Average the normals of the triangles by their area; unit vertex normals (m, 3)."""

def surroundings(
    vertices: _Floats, triangles: NDArray[np.int32]
) -> tuple[_Floats, _Floats, _Floats]:
    """Look at the neighbours of every vertex of a closed mesh.

    Returns unit normals (m, 3), the way to the middle of the neighbours within the tangent plane
    (m, 3), and the mean length of the edges (m,).
    """

def bent_vertices(
    vertices: _Floats, triangles: NDArray[np.int32], normals: _Floats, least: float
) -> NDArray[np.uint8]:
    """Whether (1 or 0) a triangle of each vertex leans away from its normal (m, 3).

    It does where the cosine between the two is below `least`.
    """

def undo_turns(
    before: _Floats, after: _Floats, triangles: NDArray[np.int32], cosine: float
) -> _Floats:
    """Move `after` (m, 3) back to `before` until no triangle turns by more than `cosine`."""

def intersecting_pairs(
    vertices: _Floats, triangles: NDArray[np.int32], suspect: NDArray[np.bool_], n_threads: int
) -> NDArray[np.int32]:
    """Find triangles that cut, touch or cover others, but for what neighbours have in common.

    Returns pairs (p, 2) of which at least one is `suspect` (t,), the lesser row first, in ascending
    order. What is nearer than 1e-4 of the size of the triangles touches.
    """

def nearest_triangles(
    vertices: _Floats, triangles: NDArray[np.int32], x: _Floats, n_threads: int
) -> tuple[_Floats, _Ints]:
    """Find the triangle nearest to every row of `x` (n, 3).

    Returns distances (n,) and triangles (n,), of equally near ones the first; infinity and the
    number of triangles where there are none.
    """

def decimate(
    vertices: _Floats, triangles: NDArray[np.int32], target: int, n_threads: int
) -> tuple[_Floats, NDArray[np.int32], NDArray[np.int32]]:
    """Collapse edges until `target` triangles are left, or none can be collapsed.

    Returns vertices (v, 3), triangles (k, 3) and the vertex (v,) that each one was.
    """

def label_pieces(triangles: NDArray[np.int32], n_vertices: int) -> _Ints:
    """Label the connected pieces of vertices (m,), in the order of their first ones."""

def handle_edges(vertices: _Floats, triangles: NDArray[np.int32]) -> NDArray[np.int32]:
    """Find two half-edges for each handle of a closed mesh (2 g,): those of tree and cotree.

    Half-edge ``3 t + k`` goes from corner k of triangle t to the next one.
    """

def open_handles(
    vertices: _Floats,
    triangles: NDArray[np.int32],
    edges: NDArray[np.int32],
    radius: _Floats,
) -> tuple[_Floats, NDArray[np.int32], NDArray[np.int32], NDArray[np.uint8]]:
    """Cut short loops around handles within `radius` (k,) of half-edges (k,), and close both sides.

    Returns vertices (m + c, 3), triangles, the vertex that each one was or is near to (m + c,), and
    whether it lies on a cut (1 or 0).
    """

class WindingTree:
    """Tree over sources (n, 3); `area` (n,) is their share in the centres of its nodes.

    Sums are single precision, relative to the mean of the points; a smoothing width is taken as at
    least 2**-26 of their largest distance from it.
    """

    def __init__(self, points: _Floats, area: _Floats, n_threads: int = 1) -> None: ...
    def order(self) -> _Ints:
        """Order (n,) in which consecutive points lie close together."""

    def winding(
        self, mu: _Floats, x: _Floats, width: _Floats, theta: float, n_threads: int
    ) -> _Floats:
        """Winding number (m,) at every row of `x` of dipoles `mu` (n, 3), smoothed over `width`.

        A node that looks smaller than the opening angle `theta` is summed at its centre;
        consecutive places share that decision.
        """

    def gradient(
        self, mu: _Floats, x: _Floats, width: _Floats, theta: float, n_threads: int
    ) -> tuple[_Floats, _Floats]:
        """Winding number (m,) and its downhill gradient (m, 3); arguments as above."""

    def lists(self, x: _Floats, theta: float, n_threads: int) -> WindingLists:
        """Find what is summed at every row of `x`, for many sums at the same places."""

    def winding_at(
        self, mu: _Floats, lists: WindingLists, width: _Floats, n_threads: int
    ) -> _Floats:
        """Sum as `winding` at the places of `lists`."""

    def gradient_at(
        self, mu: _Floats, lists: WindingLists, width: _Floats, n_threads: int
    ) -> tuple[_Floats, _Floats]:
        """Sum as `gradient` at the places of `lists`."""

    def adjoint_at(
        self, charge: _Floats, lists: WindingLists, width: _Floats, n_threads: int
    ) -> _Floats:
        """Sum as `adjoint` at the places of `lists`."""
