"""The gate that every closed mesh of the tests passes."""

from __future__ import annotations

from typing import Any

import numpy as np

from o3d_sofnn import _kernels, adapters, reference
from o3d_sofnn.geometry import mesh_properties

SMALL = 3000
"""Triangles up to which Open3D is asked as well: it compares each with each."""


def assert_valid_mesh(
    mesh: Any, triangles: Any = None, *, components: int | None = None, apart: bool = True
) -> None:
    """Check a closed mesh: an Open3D mesh of either family, or vertices and triangles.

    Finite, no triangle that names a vertex twice, no vertex unused, closed, edge- and
    vertex-manifold, consistently wound, outward, and no triangle that cuts another one, unless the
    mesh is one before all is ``apart``; ``components`` separate pieces when given.
    """
    if triangles is None:
        arrays, triangles = adapters.read_mesh(mesh)
        vertices = arrays.points
        if arrays.normals is not None:
            assert np.isfinite(arrays.normals).all(), "vertex normals are not finite"
    else:
        vertices, triangles = np.asarray(mesh), np.asarray(triangles)
    assert len(triangles) > 0, "the mesh is empty"
    assert np.isfinite(vertices).all(), "vertices are not finite"
    assert triangles.min() >= 0, "an index is negative"
    assert len(np.unique(triangles)) == len(vertices), "vertices that no triangle uses"
    assert triangles.max() < len(vertices), "an index is too large"
    assert not mesh_properties.has_repeated_indices(triangles), "a triangle names a vertex twice"
    open_edges = len(mesh_properties.boundary_edges(triangles))
    assert open_edges == 0, f"{open_edges} open edges"
    assert mesh_properties.is_edge_manifold(triangles), "not edge-manifold"
    assert mesh_properties.is_vertex_manifold(triangles), "not vertex-manifold"
    assert mesh_properties.is_consistently_wound(triangles), "not consistently wound"
    assert mesh_properties.signed_volume(vertices, triangles) > 0, "wound inward"
    if apart:
        assert_no_intersections(vertices, triangles)
        if len(triangles) <= SMALL:
            _assert_open3d_agrees(vertices, triangles)
    if components is not None:
        found = mesh_properties.component_labels(triangles)[0]
        assert found == components, f"{found} components, expected {components}"


def assert_no_intersections(vertices: Any, triangles: Any) -> None:
    """Check that no triangle cuts another one: what the kernel says, and what MeshLab says."""
    vertices = np.ascontiguousarray(vertices, np.float64)
    triangles = np.ascontiguousarray(triangles, np.int32)
    pairs = _kernels.intersecting_pairs(vertices, triangles, np.ones(len(triangles), bool), 1)
    assert len(pairs) == 0, f"{len(pairs)} pairs of triangles meet"
    named = triangles[meshlab_intersections(vertices, triangles)]
    # In a plane, rounding makes MeshLab name some that are apart.
    pairs = reference.intersecting_pairs(vertices, named, np.ones(len(named), bool))
    assert len(pairs) == 0, f"MeshLab finds {len(pairs)} pairs of triangles that meet"


def meshlab_intersections(vertices: Any, triangles: Any) -> Any:
    """Ask MeshLab for the rows of triangles that cut others."""
    import pymeshlab

    # Its tolerances are absolute.
    length = np.linalg.norm(vertices[triangles[:, 0]] - vertices[triangles[:, 1]], axis=1).mean()
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh((vertices - vertices.mean(axis=0)) / length, triangles))
    meshes.compute_selection_by_self_intersections_per_face()
    return np.flatnonzero(meshes.current_mesh().face_selection_array())


def _assert_open3d_agrees(vertices: Any, triangles: Any) -> None:
    import open3d

    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(triangles)
    )
    assert mesh.is_edge_manifold(allow_boundary_edges=False), "Open3D: not edge-manifold"
    assert mesh.is_vertex_manifold(), "Open3D: not vertex-manifold"
    assert not mesh.is_self_intersecting(), "Open3D: triangles cut others"
    assert mesh.is_watertight(), "Open3D: not watertight"
    assert mesh.get_volume() > 0.0, "Open3D: no volume"
