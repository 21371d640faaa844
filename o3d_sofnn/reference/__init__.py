"""Slow, readable numpy twins of the native kernels: what these compute, and their tests' oracle.

Each twin takes the arguments of its kernel, with points in place of a tree over
them, :class:`Rules` in place of a view of rules, and without a number of threads, and returns
arrays of the same shapes. Nothing in the package calls them.
"""

from o3d_sofnn.reference.geometry.morton import sort_morton
from o3d_sofnn.reference.geometry.neighbors import crowded, query
from o3d_sofnn.reference.implicit.field import evaluate_field
from o3d_sofnn.reference.implicit.rlps import reconstruct_units
from o3d_sofnn.reference.meshing.decimation import decimate
from o3d_sofnn.reference.meshing.distance import nearest_triangles
from o3d_sofnn.reference.meshing.grid import DualWalk
from o3d_sofnn.reference.meshing.handles import handle_edges, open_handles
from o3d_sofnn.reference.meshing.intersections import intersecting_pairs
from o3d_sofnn.reference.meshing.marching_cubes import marching_cubes
from o3d_sofnn.reference.meshing.mesh import (
    bent_vertices,
    label_pieces,
    surroundings,
    undo_turns,
    vertex_normals,
)
from o3d_sofnn.reference.orientation.winding import evaluate_winding
from o3d_sofnn.reference.rules.inference import consequent_errors, infer_normals
from o3d_sofnn.reference.rules.rules import Rules
from o3d_sofnn.reference.sampling.local_fit import Wanted, fit_quadrics, fit_scales
from o3d_sofnn.reference.sampling.sides import divide_cells
from o3d_sofnn.reference.sampling.typical_data import typical_data

__all__ = [
    "DualWalk",
    "Rules",
    "Wanted",
    "bent_vertices",
    "consequent_errors",
    "crowded",
    "decimate",
    "divide_cells",
    "evaluate_field",
    "evaluate_winding",
    "fit_quadrics",
    "fit_scales",
    "handle_edges",
    "infer_normals",
    "intersecting_pairs",
    "label_pieces",
    "marching_cubes",
    "nearest_triangles",
    "open_handles",
    "query",
    "reconstruct_units",
    "sort_morton",
    "surroundings",
    "typical_data",
    "undo_turns",
    "vertex_normals",
]
