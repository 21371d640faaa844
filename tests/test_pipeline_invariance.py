"""What must not change the result of the pipeline, or only move it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_checks import assert_valid_mesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from shapes import angles, torus

from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.pipeline import estimate_normals, reconstruct_surface

FEW = settings(max_examples=3, deadline=None, derandomize=True)


def cloud(seed, n=600):
    """A torus that has no symmetry: noise, uneven density."""
    shape = torus(2 * n, seed=seed)
    keep = np.random.default_rng(seed + 2002).random(2 * n) < 0.5 + 0.2 * np.sign(
        shape.points[:, 0]
    )
    return shape._replace(points=shape.points[keep], normals=shape.normals[keep]).noisy(
        0.01, seed + 1001
    )


@FEW
@given(seed=st.integers(0, 1000))
def test_order_of_points_changes_nothing(seed):
    points = cloud(seed).points
    order = np.random.default_rng(seed).permutation(len(points))
    one, other = estimate_normals(points), estimate_normals(points[order])
    assert other.normals.tobytes() == one.normals[order].tobytes()
    assert other.confidence.tobytes() == one.confidence[order].tobytes()
    np.testing.assert_array_equal(other.outliers, one.outliers[order])
    surface, shuffled = reconstruct_surface(points), reconstruct_surface(points[order])
    assert surface.vertices.tobytes() == shuffled.vertices.tobytes()
    assert surface.triangles.tobytes() == shuffled.triangles.tobytes()
    difference = surface.source_weights[:, order] - shuffled.source_weights
    assert abs(difference).max() < 1e-12


@FEW
@given(exponent=st.integers(-20, 20), seed=st.integers(0, 1000))
def test_powers_of_two_in_scale_change_no_bit(exponent, seed):
    points, factor = cloud(seed).points, 2.0**exponent
    one, other = estimate_normals(points), estimate_normals(points * factor)
    assert one.normals.tobytes() == other.normals.tobytes()
    assert other.noise_level == one.noise_level * factor
    surface, scaled = reconstruct_surface(points), reconstruct_surface(points * factor)
    assert (surface.vertices * factor).tobytes() == scaled.vertices.tobytes()
    assert surface.triangles.tobytes() == scaled.triangles.tobytes()


def assert_equivalent(points, moved, turn, back, *, typical, apart):
    """Compare normals in degrees, and meshes in cubes, before and after a motion."""
    one, other = estimate_normals(points), estimate_normals(moved)
    error = angles(other.normals, turn(one.normals))
    assert np.median(error) < typical
    assert error.max() < 90.0, "a normal changed sides"
    surface, after = reconstruct_surface(points), reconstruct_surface(moved)
    assert_valid_mesh(after.vertices, after.triangles)
    euler = mesh_properties.euler_characteristic
    assert euler(after.triangles) == euler(surface.triangles)
    vertices = back(after.vertices)
    volume = mesh_properties.signed_volume(vertices, after.triangles)
    assert volume == pytest.approx(
        mesh_properties.signed_volume(surface.vertices, surface.triangles), rel=0.01
    )
    distance = cKDTree(surface.vertices).query(vertices)[0]
    assert np.quantile(distance, 0.99) < apart * surface.voxel_size
    assert distance.max() < 3.0 * surface.voxel_size


@FEW
@given(seed=st.integers(0, 1000))
def test_rotation_turns_the_result(seed):
    turn = Rotation.random(random_state=seed).as_matrix()
    points = cloud(seed, 1000).points
    assert_equivalent(
        points,
        np.ascontiguousarray(points @ turn.T),
        lambda n: n @ turn.T,
        lambda v: v @ turn,
        typical=2.0,  # cells are cut elsewhere
        apart=1.2,
    )


@FEW
@given(exponent=st.floats(-6.0, 6.0), seed=st.integers(0, 1000))
def test_scale_only_scales_the_result(exponent, seed):
    points, factor = cloud(seed).points, 10.0**exponent
    assert_equivalent(
        points, points * factor, lambda n: n, lambda v: v / factor, typical=0.01, apart=0.5
    )


@FEW
@given(offset=st.tuples(*[st.floats(-1e6, 1e6)] * 3), seed=st.integers(0, 1000))
def test_translation_only_moves_the_result(offset, seed):
    points = cloud(seed).points
    assert_equivalent(
        points, points + offset, lambda n: n, lambda v: v - offset, typical=0.01, apart=0.5
    )


@pytest.mark.parametrize("n_threads", [2, 3])
def test_number_of_threads_changes_no_bit(n_threads):
    points = cloud(0, 3000).points
    one, other = (reconstruct_surface(points, n_threads=n) for n in (1, n_threads))
    assert one.vertices.tobytes() == other.vertices.tobytes()
    assert one.triangles.tobytes() == other.triangles.tobytes()
    assert one.vertex_normals.tobytes() == other.vertex_normals.tobytes()
    assert one.normals.normals.tobytes() == other.normals.normals.tobytes()
    assert one.normals.confidence.tobytes() == other.normals.confidence.tobytes()
    assert abs(one.source_weights - other.source_weights).max() == 0.0


def test_same_points_same_result():
    points = cloud(0).points
    one, other = reconstruct_surface(points), reconstruct_surface(points.copy())
    assert one.vertices.tobytes() == other.vertices.tobytes()


def test_repeated_points_change_nothing():
    points = cloud(1).points
    repeated = np.concatenate([points, points[::3], points[:1]])
    one, other = estimate_normals(points), estimate_normals(repeated)
    n = len(points)
    assert other.normals[:n].tobytes() == one.normals.tobytes()
    assert other.normals[n:-1].tobytes() == one.normals[::3].tobytes()
    surface, same = reconstruct_surface(points), reconstruct_surface(repeated)
    assert surface.vertices.tobytes() == same.vertices.tobytes()
    assert same.source_weights.shape[1] == len(repeated)
    np.testing.assert_allclose(same.source_weights.sum(axis=1), 1.0, atol=1e-12)


def test_input_is_left_alone():
    points = cloud(2).points
    before = points.copy()
    points.setflags(write=False)
    reconstruct_surface(points)
    np.testing.assert_array_equal(points, before)
