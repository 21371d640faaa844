"""From the field to triangles, and work on meshes."""

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]
_Ints = NDArray[np.int64]

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

    Tables as ``both_tables`` of ``meshing/isosurface/marching_cubes.py`` gives them. Vertices stay
    away from the nodes by ``nudges[0]`` of the edge. Returns vertices (v, 3), triangles (t, 3) that
    face outward, the vertices (k,) beside cubes with corners that coincide and their places (k, 3)
    ``nudges[1]`` away.
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
    largest: int,
) -> tuple[_Floats, NDArray[np.int32], NDArray[np.int32], NDArray[np.uint8]]:
    """Cut short loops around handles within `radius` (k,) of half-edges (k,), and close both sides.

    At most `largest` triangles around each half-edge are looked at.

    Returns vertices (m + c, 3), triangles, the vertex that each one was or is near to (m + c,), and
    whether it lies on a cut (1 or 0).
    """
