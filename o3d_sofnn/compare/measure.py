"""Accuracy of a mesh, compared with the points and with the true surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn._kernels import nearest_triangles
from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.geometry.vectors import unit
from o3d_sofnn.threads import thread_count

if TYPE_CHECKING:
    from o3d_sofnn.compare.peers import Mesh

Array = NDArray[Any]

F_SCORE_DISTANCE = 0.002
"""Threshold of the F-score, as a fraction of the diagonal."""


@dataclass(frozen=True)
class Truth:
    """A closed mesh, and its normals at the points that were drawn from it."""

    vertices: Array
    triangles: Array
    normals: Array


FIGURES = {
    "seconds": "time, s",
    "peak_mb": "memory, MB",
    "triangles": "triangles",
    "components": "components",
    "holes": "holes",
    "watertight": "watertight",
    "manifold": "manifold",
    "input_mean": "input to surface, mean",
    "input_max": "input to surface, largest",
    "chamfer": "Chamfer",
    "hausdorff": "Hausdorff",
    "f_score": "F-score",
    "normal_consistency": "normal consistency",
    "flipped": "flipped normals, %",
}
"""Columns and their titles; distances are in thousandths of the diagonal."""
YES_OR_NO = ("watertight", "manifold")
WHOLE = ("triangles", "components", "holes", "runs", "failed", "peak_mb", "points")
"""Figures that are true or false, and figures without decimals."""


def figures(points: Array, mesh: Mesh, truth: Truth | None, count: int) -> dict[str, float]:
    """Measure a mesh.

    Parameters
    ----------
    points : (n, 3) float64
        The input.
    mesh : Mesh
        The result.
    truth : Truth or None
        The true surface, if it is known.
    count : int
        Number of points drawn from each surface for the comparison with the truth.

    Returns
    -------
    dict of str to float
        Figures with the keys ``FIGURES``, except time and memory. Without a truth, those that need
        one are missing.
    """
    v, f = mesh.vertices, mesh.triangles
    thousandth = 1e-3 * float(np.linalg.norm(np.ptp(points, axis=0)))
    inward = distances(points, v, f)[0] / thousandth
    found = {
        "triangles": len(f),
        "components": mesh_properties.component_labels(f)[0],
        "holes": _count_loops(mesh_properties.boundary_edges(f)),
        "watertight": float(mesh_properties.is_watertight(f)),
        "manifold": float(
            mesh_properties.is_edge_manifold(f) and mesh_properties.is_vertex_manifold(f)
        ),
        "input_mean": inward.mean(),
        "input_max": inward.max(),
    }
    if truth is not None:
        here, here_normals = mesh_properties.sample_surface(v, f, count)
        there, there_normals = mesh_properties.sample_surface(
            truth.vertices, truth.triangles, count
        )
        out, out_normals = distances(here, truth.vertices, truth.triangles)
        back, back_normals = distances(there, v, f)
        out, back = out / thousandth, back / thousandth
        limit = 1e3 * F_SCORE_DISTANCE
        precision, recall = (out < limit).mean(), (back < limit).mean()
        found["chamfer"] = 0.5 * (out.mean() + back.mean())
        found["hausdorff"] = max(out.max(), back.max())
        found["f_score"] = 2.0 * precision * recall / max(precision + recall, 1e-12)
        found["normal_consistency"] = 0.5 * (
            np.einsum("ij,ij->i", here_normals, out_normals).mean()
            + np.einsum("ij,ij->i", there_normals, back_normals).mean()
        )
        if mesh.normals is not None:
            found["flipped"] = 100.0 * mesh_properties.flipped_fraction(mesh.normals, truth.normals)
    return {key: float(value) for key, value in found.items()}


def turned(row: dict[str, Any]) -> dict[str, Any] | None:
    """Return the figures of a result with its sides turned once, if they are wrong as a whole.

    Parameters
    ----------
    row : dict
        Keys of ``FIGURES``, and others, which are kept.

    Returns
    -------
    dict or None
        Normals are turned if more than half of them are flipped, triangles if on the whole they
        face away from the truth. None if neither is so, or the truth is not known.
    """
    found = dict(row)
    if (row.get("flipped") or 0.0) > 50.0:
        found["flipped"] = 100.0 - row["flipped"]
    if (row.get("normal_consistency") or 0.0) < 0.0:
        found["normal_consistency"] = -row["normal_consistency"]
    return None if found == row else found


def show(key: str, value: float) -> str:
    """Return a figure as readable text."""
    if key in YES_OR_NO:
        return {0.0: "no", 1.0: "yes"}.get(value, f"{100 * value:.0f} %")
    if key in WHOLE:
        return f"{value:,.0f}"
    return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"


def distances(x: Array, vertices: Array, triangles: Array) -> tuple[Array, Array]:
    """Return distances of (n, 3) queries from a mesh, and the normals of the nearest triangles."""
    mesh = np.ascontiguousarray(vertices, np.float64), np.ascontiguousarray(triangles, np.int32)
    places = np.ascontiguousarray(x, np.float64)
    distance, nearest = map(np.asarray, nearest_triangles(*mesh, places, thread_count()))
    return distance, unit(mesh_properties.area_vectors(vertices, triangles[nearest]))


def _count_loops(edges: Array) -> int:
    """Count the connected groups of border edges."""
    # component_labels takes triangles: an edge is one with a repeated corner.
    return mesh_properties.component_labels(edges[:, [0, 1, 1]])[0] if len(edges) else 0
