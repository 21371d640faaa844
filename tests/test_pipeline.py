"""Arrays in, arrays out: accuracy and validity."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_checks import assert_valid_mesh
from scipy.spatial import cKDTree
from shapes import angles, box, join, plane_patch, sphere, torus, two_spheres

from o3d_sofnn.geometry import mesh_properties
from o3d_sofnn.pipeline import estimate_normals, reconstruct_surface
from o3d_sofnn.progress import STAGES

SHAPES = {
    "sphere": (sphere(2000), 1, 2, 4.0 / 3.0 * np.pi),
    "torus": (torus(3000), 1, 0, 2.0 * np.pi**2 * 0.4**2),
    "box": (box(3000), 1, 2, 1.0),
    "two spheres": (two_spheres(3000), 2, 4, 8.0 / 3.0 * np.pi),
}
"""Shape, pieces, Euler number, volume."""


# --- normals


@pytest.mark.parametrize(
    ("name", "noise", "typical", "worst"),
    [
        ("sphere", 0.0, 0.3, 4.0),
        ("sphere", 0.005, 1.0, 4.0),
        ("sphere", 0.02, 3.0, 10.0),
        ("torus", 0.0, 0.5, 8.0),
        ("torus", 0.005, 2.0, 8.0),
        ("torus", 0.02, 5.0, 25.0),
        ("two spheres", 0.005, 1.0, 4.0),
    ],
)
def test_normals_of_smooth_shapes(name, noise, typical, worst):
    shape = SHAPES[name][0]
    error = angles(estimate_normals(shape.noisy(noise).points).normals, shape.normals)
    assert np.median(error) < typical
    assert error.max() < worst


@pytest.mark.parametrize(("noise", "typical", "most"), [(0.0, 0.05, 15.0), (0.005, 5.0, 45.0)])
def test_normals_keep_edges(noise, typical, most):
    shape = SHAPES["box"][0]
    error = angles(estimate_normals(shape.noisy(noise).points).normals, shape.normals)
    assert np.median(error) < typical
    assert np.quantile(error, 0.95) < most


def test_normals_of_a_plane_are_parallel():
    normals = estimate_normals(plane_patch(500).points).normals
    assert (np.abs(normals[:, 2]) > 1.0 - 1e-9).all()
    assert len(np.unique(np.sign(normals[:, 2]))) == 1


@pytest.mark.parametrize("n", [4, 5, 8, 13, 30, 100])
def test_few_points(n):
    points = sphere(n).points
    normals = estimate_normals(points).normals
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    surface = reconstruct_surface(points)
    assert surface.watertight
    assert_valid_mesh(surface.vertices, surface.triangles)


@pytest.mark.parametrize("max_nn", [4, 8, 11, 12, 30])
def test_small_neighborhoods_are_allowed(max_nn):
    shape = torus(1000)
    found = estimate_normals(shape.points, max_nn=max_nn)
    assert np.median(angles(found.normals, shape.normals)) < 2.0


def test_details():
    shape = join(sphere(2000).noisy(0.01), sphere(2).scaled(3.0))
    found = estimate_normals(shape.points)
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1.0, atol=1e-12)
    assert found.confidence.shape == found.outliers.shape == found.noise.shape == (2002,)
    assert ((found.confidence >= 0.0) & (found.confidence <= 1.0)).all()
    assert found.outliers[-2:].all()
    assert not found.outliers[:-2].any()
    assert found.noise_level == pytest.approx(0.01, rel=0.2)
    assert found.spacing == pytest.approx(np.sqrt(4.0 * np.pi / 2000), rel=0.2)
    assert set(found.seconds) < set(STAGES)
    assert np.abs(np.linalg.norm(found.rules.feet, axis=1) - 1.0).max() < 0.05


def test_rules_are_in_the_coordinates_of_the_points():
    found = estimate_normals(sphere(500).moved((10.0, -20.0, 30.0)).points)
    distance = np.linalg.norm(found.rules.feet - [10.0, -20.0, 30.0], axis=1)
    assert np.abs(distance - 1.0).max() < 0.05


def test_viewpoint_and_direction():
    points = plane_patch(500).moved((100.0, 0.0, 50.0)).points
    below = estimate_normals(points, viewpoint=np.array([100.0, 0.0, 40.0])).normals
    assert (below[:, 2] < 0.0).all()
    assert (estimate_normals(points, towards=np.array([0.0, 0.0, 1.0])).normals[:, 2] > 0.0).all()


# --- surfaces


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("option", ["towards", "viewpoint"])
def test_the_solid_of_terrain_is_on_the_side_that_was_asked_for(option, sign):
    points = plane_patch(3000).points
    points[:, 2] = 0.1 * np.sin(5.0 * points[:, 0]) * np.cos(4.0 * points[:, 1])
    side = {option: np.array([0.0, 0.0, {"towards": 1.0, "viewpoint": 9.0}[option] * sign])}
    sheet = reconstruct_surface(points, trim=0.5, **side)
    area = mesh_properties.area_vectors(sheet.vertices, sheet.triangles)
    assert (sign * area[:, 2] > 0.0).mean() > 0.998
    assert (sign * sheet.normals.normals[:, 2] > 0.0).all()
    solid = reconstruct_surface(points, closed=True, **side)
    assert solid.watertight
    # The data end at 0.1 on both sides; the solid goes on.
    assert sign * (solid.vertices[:, 2].max() + solid.vertices[:, 2].min()) < -0.03


@pytest.mark.parametrize("noise", [0.0, 0.005])
@pytest.mark.parametrize("name", SHAPES)
def test_surfaces(name, noise):
    shape, n_pieces, euler, volume = SHAPES[name]
    surface = reconstruct_surface(shape.noisy(noise).points)
    assert surface.watertight
    assert_valid_mesh(surface.vertices, surface.triangles, components=n_pieces)
    assert mesh_properties.euler_characteristic(surface.triangles) == euler
    found = mesh_properties.signed_volume(surface.vertices, surface.triangles)
    assert found == pytest.approx(volume, rel=0.03)
    distance = cKDTree(surface.vertices).query(shape.points)[0]
    assert distance.max() < 1.5 * surface.voxel_size + 3.0 * noise
    np.testing.assert_allclose(np.linalg.norm(surface.vertex_normals, axis=1), 1.0, atol=1e-12)
    assert len(surface.confidence) == len(surface.vertices)


def test_vertex_normals_are_those_of_the_shape():
    surface = reconstruct_surface(sphere(2000).points)
    truth = surface.vertices / np.linalg.norm(surface.vertices, axis=1, keepdims=True)
    error = angles(surface.vertex_normals, truth)
    assert np.median(error) < 0.5
    assert np.quantile(error, 0.99) < 4.0


def test_a_hollow_ball_keeps_its_cavity():
    inner = sphere(500, radius=0.5, seed=1)
    surface = reconstruct_surface(join(sphere(2000), inner).points)
    assert_valid_mesh(surface.vertices, surface.triangles, components=2)
    found = mesh_properties.signed_volume(surface.vertices, surface.triangles)
    assert found == pytest.approx(4.0 / 3.0 * np.pi * (1.0 - 0.125), rel=0.02)


def test_a_hole_in_the_data_is_closed():
    shape = sphere(3000)
    surface = reconstruct_surface(shape.points[shape.points[:, 2] < 0.8])
    assert_valid_mesh(surface.vertices, surface.triangles, components=1)
    assert mesh_properties.euler_characteristic(surface.triangles) == 2
    top = surface.vertices[:, 2] > 0.7
    assert np.median(surface.confidence[~top]) > 0.9
    middle = np.hypot(*surface.vertices[:, :2].T).argsort()[:20]
    middle = middle[surface.vertices[middle, 2].argmax()]
    assert surface.vertices[middle, 2] > 0.7
    assert surface.confidence[middle] < 0.5


def test_trimming_opens_what_no_data_supports():
    shape = sphere(3000)
    points = shape.points[shape.points[:, 2] < 0.5]
    surface = reconstruct_surface(points, trim=0.5)
    assert not surface.watertight
    assert len(mesh_properties.boundary_edges(surface.triangles)) > 0
    assert surface.vertices[:, 2].max() < 0.7


def test_given_sides_are_kept():
    shape = sphere(1000)
    surface = reconstruct_surface(shape.points, normals=shape.normals)
    assert_valid_mesh(surface.vertices, surface.triangles, components=1)
    cosine = (surface.normals.normals * shape.normals).sum(axis=1)
    assert (cosine > 0.9).all()


def test_cube_size_is_what_was_asked_for():
    points = sphere(1000).points
    assert reconstruct_surface(points, voxel_size=0.1).voxel_size == 0.1
    size = reconstruct_surface(points, depth=5).voxel_size
    assert size == pytest.approx(np.ptp(points, axis=0).max() / 32)
    with pytest.raises(ValueError, match="voxel_size"):
        reconstruct_surface(points, voxel_size=1e-7)


def test_attributes_are_carried_over():
    points = sphere(1000).points
    surface = reconstruct_surface(points)
    weights = surface.source_weights
    assert weights.shape == (len(surface.vertices), 1000)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-12)
    assert weights.data.min() >= 0.0
    assert np.median(np.linalg.norm(weights @ points - surface.vertices, axis=1)) < 0.1


# --- bad input


@pytest.mark.parametrize("operator", [estimate_normals, reconstruct_surface])
@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        sphere(3).points,
        np.ones((20, 3)),
        np.arange(60.0).reshape(20, 3),
    ],
    ids=["empty", "three", "equal", "on a line"],
)
def test_clouds_without_a_surface_are_refused(operator, points):
    with pytest.raises(ValueError, match="points"):
        operator(points)


@pytest.mark.parametrize("options", [{}, {"closed": False}, {"trim": 0.5}], ids=repr)
def test_a_flat_cloud_is_a_sheet_unless_it_shall_enclose_something(options):
    points = plane_patch(1000).points
    with pytest.raises(ValueError, match="closed=False"):
        reconstruct_surface(points, closed=True)
    surface = reconstruct_surface(points, **options)
    assert len(surface.triangles)
    assert np.abs(surface.vertices[:, 2]).max() < surface.voxel_size


def test_progress_grows_to_one_and_can_stop_the_work():
    seen = []
    reconstruct_surface(sphere(300).points, progress=lambda done, text: seen.append((done, text)))
    fractions = [done for done, _ in seen]
    assert fractions[0] == 0.0
    assert fractions[-1] == 1.0
    assert {text for _, text in seen} <= set(STAGES) | {"done"}

    def stop(done, _):
        if done > 0.1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        reconstruct_surface(sphere(300).points, progress=stop)


def test_first_rules_are_found_and_timed_anew_without_outliers():
    shape = sphere(2000)
    stray = np.random.default_rng(0).uniform(-1.5, 1.5, (200, 3))
    seen = []
    estimate_normals(
        np.concatenate([shape.points, stray]),
        progress=lambda done, text: seen.append((done, text)),
    )
    assert [text for _, text in seen].count("typical data") == 2
    fractions = [done for done, _ in seen]
    assert fractions == sorted(fractions)


def test_the_length_of_known_normals_does_not_matter():
    shape = box(2000)
    some = [
        reconstruct_surface(shape.points, normals=length * shape.normals, voxel_size=0.05)
        for length in (1.0, 2.0**-10)
    ]
    np.testing.assert_array_equal(some[0].vertices, some[1].vertices)
    np.testing.assert_array_equal(some[0].triangles, some[1].triangles)
