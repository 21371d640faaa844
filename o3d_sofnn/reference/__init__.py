"""Slow, readable numpy twins of the native kernels: what these compute, and their tests' oracle.

Each twin takes the arguments of its kernel in the same order, with points in place of a tree over
them, :class:`Rules` in place of a view of rules, and without a number of threads, and returns
arrays of the same shapes. Nothing in the package calls them.
"""

from .field import evaluate_field
from .grid import DualWalk
from .handles import handle_edges, open_handles
from .inference import consequent_errors, infer_normals
from .local_fit import fit_rules, fit_scales
from .marching_cubes import marching_cubes
from .mesh import bent_vertices, label_pieces, surroundings, undo_turns, vertex_normals
from .morton import sort_morton
from .neighbors import crowded, query
from .rlps import reconstruct_units
from .rules import Rules
from .sides import divide_cells
from .typical_data import typical_data
from .winding import evaluate_winding

__all__ = [
    "DualWalk",
    "Rules",
    "bent_vertices",
    "consequent_errors",
    "crowded",
    "divide_cells",
    "evaluate_field",
    "evaluate_winding",
    "fit_rules",
    "fit_scales",
    "handle_edges",
    "infer_normals",
    "label_pieces",
    "marching_cubes",
    "open_handles",
    "query",
    "reconstruct_units",
    "sort_morton",
    "surroundings",
    "typical_data",
    "undo_turns",
    "vertex_normals",
]
