"""Native kernels: the loops over points, rules, cells and grid nodes.

Arrays are C-contiguous and on the host: float64 but for the int64 counts and offsets. Kernels check
types, shapes, lengths and indices: a ValueError that names the argument. Coordinates of about unit
size give finite results whatever else they are; others and what is no number, results without
meaning. Kernels release the GIL and have no global state. Their results do not depend on
``n_threads``; trees and views keep theirs for what is asked of them. Where the system gives fewer
threads, kernels make do with those; memory that is missing in any of them is a MemoryError.
:mod:`o3d_sofnn.reference` has a slow twin of each.

The module is one; its stubs are by the rooms of the package.
"""

from o3d_sofnn._kernels.geometry import KdTree as KdTree
from o3d_sofnn._kernels.geometry import sort_morton as sort_morton
from o3d_sofnn._kernels.implicit import evaluate_field as evaluate_field
from o3d_sofnn._kernels.implicit import reconstruct_units as reconstruct_units
from o3d_sofnn._kernels.meshing import DualWalk as DualWalk
from o3d_sofnn._kernels.meshing import bent_vertices as bent_vertices
from o3d_sofnn._kernels.meshing import decimate as decimate
from o3d_sofnn._kernels.meshing import handle_edges as handle_edges
from o3d_sofnn._kernels.meshing import intersecting_pairs as intersecting_pairs
from o3d_sofnn._kernels.meshing import label_pieces as label_pieces
from o3d_sofnn._kernels.meshing import marching_cubes as marching_cubes
from o3d_sofnn._kernels.meshing import nearest_triangles as nearest_triangles
from o3d_sofnn._kernels.meshing import open_handles as open_handles
from o3d_sofnn._kernels.meshing import surroundings as surroundings
from o3d_sofnn._kernels.meshing import undo_turns as undo_turns
from o3d_sofnn._kernels.meshing import vertex_normals as vertex_normals
from o3d_sofnn._kernels.orientation import WindingLists as WindingLists
from o3d_sofnn._kernels.orientation import WindingTree as WindingTree
from o3d_sofnn._kernels.rules import RuleView as RuleView
from o3d_sofnn._kernels.rules import consequent_errors as consequent_errors
from o3d_sofnn._kernels.rules import infer_normals as infer_normals
from o3d_sofnn._kernels.sampling import divide_cells as divide_cells
from o3d_sofnn._kernels.sampling import fit_quadrics as fit_quadrics
from o3d_sofnn._kernels.sampling import fit_scales as fit_scales
from o3d_sofnn._kernels.sampling import typical_data as typical_data
