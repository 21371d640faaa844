"""The gate that every closed mesh of the tests passes."""

from __future__ import annotations

from typing import Any

import numpy as np

from o3d_sofnn import adapters
from o3d_sofnn.geometry import mesh_properties


def assert_valid_mesh(mesh: Any, triangles: Any = None, *, components: int | None = None) -> None:
    """Check a closed mesh: an Open3D mesh of either family, or vertices and triangles.

    Finite, no triangle that names a vertex twice, no vertex unused, closed, edge- and
    vertex-manifold, consistently wound, outward; ``components`` separate pieces when given.
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
    if components is not None:
        found = mesh_properties.component_labels(triangles)[0]
        assert found == components, f"{found} components, expected {components}"
