"""What a layer of PyMeshLab must hold; also for Pythons that have nothing but numpy beside it."""

from __future__ import annotations

from typing import Any

import numpy as np


def assert_is_surface(mesh: Any, expected: Any) -> None:
    """Check a layer against a ``SurfaceEstimate``, to the last bit."""
    np.testing.assert_array_equal(mesh.vertex_matrix(), expected.vertices)
    np.testing.assert_array_equal(mesh.face_matrix(), expected.triangles)
    np.testing.assert_array_equal(mesh.vertex_normal_matrix(), expected.vertex_normals)
    np.testing.assert_array_equal(mesh.vertex_scalar_array(), expected.confidence)
