"""The gate behind the stages."""

from __future__ import annotations

import numpy as np
import pytest

from o3d_sofnn import pipeline
from o3d_sofnn.geometry.checks import check_mesh, check_stage
from o3d_sofnn.implicit.field import Field

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def test_finite_arrays_pass():
    check_stage("growth", normals=CORNERS, counts=np.arange(3), none=np.zeros((0, 3)))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_names_the_stage(bad):
    values = CORNERS.copy()
    values[1:3, 0] = bad
    with pytest.raises(ValueError, match=r"points: .*: 2 normals are not finite .* 'growth'"):
        check_stage("growth", counts=np.arange(3), normals=values)


def test_a_closed_mesh_passes_and_an_open_one_where_it_may_be_open():
    assert check_mesh(CORNERS, TETRAHEDRON, closed=True)
    assert not check_mesh(CORNERS, TETRAHEDRON[1:], closed=False)


@pytest.mark.parametrize(
    ("vertices", "triangles", "message"),
    [
        (
            np.where(CORNERS > 0.0, np.inf, 0.0),
            TETRAHEDRON,
            "vertices are not finite after stage 'surface'",
        ),
        (CORNERS[:3], TETRAHEDRON, "'surface' names vertices that are not"),
        (CORNERS, TETRAHEDRON - 1, "'surface' names vertices that are not"),
        (CORNERS, TETRAHEDRON[1:], "'surface' has left the mesh open"),
        (CORNERS, TETRAHEDRON[:0], "'surface' has left the mesh open"),
        # Two triangles at every edge, but one of them the wrong way round.
        (CORNERS, np.concatenate([TETRAHEDRON[1:], [[0, 1, 2]]]), "left the mesh open"),
        (CORNERS, np.concatenate([TETRAHEDRON, TETRAHEDRON]), "left the mesh open"),
    ],
)
def test_a_mesh_that_is_none_names_the_stage(vertices, triangles, message):
    with pytest.raises(ValueError, match=message):
        check_mesh(vertices, triangles, closed=True)


def test_a_field_that_is_no_number_ends_the_reconstruction(monkeypatch):
    points = np.random.default_rng(0).normal(size=(200, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)

    def broken(field, x):
        return np.full(len(x), np.nan), np.ones(len(x))

    monkeypatch.setattr(Field, "_evaluate", broken)
    with pytest.raises(ValueError, match="not finite after stage 'field'"):
        pipeline.reconstruct_surface(points)
