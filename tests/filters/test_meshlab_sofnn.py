"""The filters for PyMeshLab, against the real PyMeshLab."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from layer_checks import assert_is_surface

from o3d_sofnn import pipeline

pymeshlab = pytest.importorskip("pymeshlab", reason="PyMeshLab is not installed")
import meshlab_sofnn  # noqa: E402 - it needs PyMeshLab
from meshlab_sofnn import engine, layers  # noqa: E402

MATRIX = np.array(
    [
        [0.0, -2.0, 0.0, 1.0 / 3.0],
        [2.0, 0.0, 0.0, 1000.0 + 1.0 / 7.0],
        [0.0, 0.0, 2.0, -5.0],
        [0.0, 0.0, 0.0, 1.0],
    ]
)


def test_the_mesh_is_the_operators_mesh(ms: Any, points: Any, colors: Any) -> None:
    o3d = pytest.importorskip("open3d")
    import o3d_sofnn

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud.colors = o3d.utility.Vector3dVector(colors[:, :3] / 255)
    expected = o3d_sofnn.reconstruct_surface(cloud)
    meshlab_sofnn.reconstruct(ms)
    mesh = ms.current_mesh()
    np.testing.assert_array_equal(
        mesh.vertex_matrix().astype(np.float32), np.asarray(expected.vertices, dtype=np.float32)
    )
    np.testing.assert_array_equal(mesh.face_matrix(), np.asarray(expected.triangles))
    np.testing.assert_array_equal(
        mesh.vertex_normal_matrix().astype(np.float32),
        np.asarray(expected.vertex_normals, dtype=np.float32),
    )
    # MeshLab has eight bits for a colour.
    np.testing.assert_allclose(
        mesh.vertex_color_matrix()[:, :3], np.asarray(expected.vertex_colors), atol=0.501 / 255
    )


def test_the_normals_are_the_operators_normals(ms: Any, points: Any) -> None:
    o3d = pytest.importorskip("open3d")
    import o3d_sofnn

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    o3d_sofnn.estimate_normals(cloud)
    meshlab_sofnn.estimate_normals(ms)
    np.testing.assert_array_equal(
        ms.current_mesh().vertex_normal_matrix().astype(np.float32),
        np.asarray(cloud.normals, dtype=np.float32),
    )


def test_reconstruct_adds_one_layer_and_touches_nothing_else(
    ms: Any, points: Any, state: Any
) -> None:
    before, _, script = state(ms)
    summary = meshlab_sofnn.reconstruct(ms)
    after, current, script_after = state(ms)
    assert after[:1] == before
    assert len(after) == 2
    assert script_after == script
    assert current == after[1][0]
    assert ms.current_mesh().label() == "SOFNN mesh"
    assert ms.current_mesh().is_visible()
    np.testing.assert_array_equal(ms.current_mesh().transform_matrix(), np.eye(4))
    expected = pipeline.reconstruct_surface(points)
    assert_is_surface(ms.current_mesh(), expected)
    assert summary["voxel_size"] == expected.voxel_size
    assert summary["watertight"] is True
    assert summary["ignored_points"] == 0
    assert {"noise_level", "spacing", "outliers", "offset_points", "seconds"} <= set(summary)

    ms.set_current_mesh(0)
    meshlab_sofnn.reconstruct(ms)
    assert (ms.current_mesh_id(), ms.current_mesh().label()) == (2, "SOFNN mesh(1)")


def test_the_layers_matrix_is_applied(ms: Any, state: Any) -> None:
    ms.apply_filter("set_matrix", transformmatrix=MATRIX, freeze=False)
    before, _, _ = state(ms)
    world = np.ascontiguousarray(ms.current_mesh().transformed_vertex_matrix())
    diagonal = np.linalg.norm(np.ptp(world, axis=0))
    meshlab_sofnn.reconstruct(ms)
    assert state(ms)[0][:1] == before
    assert_is_surface(ms.current_mesh(), pipeline.reconstruct_surface(world))
    ms.set_current_mesh(0)
    summary = meshlab_sofnn.reconstruct(ms, voxel_size=pymeshlab.PercentageValue(5))
    assert summary["voxel_size"] == pytest.approx(0.05 * diagonal, rel=1e-6)


def test_normals_go_back_through_the_layers_matrix(ms: Any, points: Any, state: Any) -> None:
    ms.apply_filter("set_matrix", transformmatrix=MATRIX, freeze=False)
    before, _, script = state(ms)
    world = np.ascontiguousarray(ms.current_mesh().transformed_vertex_matrix())
    meshlab_sofnn.estimate_normals(ms)
    after, _, script_after = state(ms)
    assert [mesh[:5] + mesh[6:] for mesh in after] == [mesh[:5] + mesh[6:] for mesh in before]
    assert script_after == script
    turn = MATRIX[:3, :3] / 2.0
    np.testing.assert_allclose(
        ms.current_mesh().vertex_normal_matrix() @ turn.T,
        pipeline.estimate_normals(world).normals,
        atol=1e-12,
    )


def test_normals_can_be_estimated_again(ms: Any, points: Any) -> None:
    meshlab_sofnn.estimate_normals(ms, orientation="direction", direction=(1, 0, 0))
    meshlab_sofnn.estimate_normals(ms)
    np.testing.assert_array_equal(
        ms.current_mesh().vertex_normal_matrix(), pipeline.estimate_normals(points).normals
    )
    assert ms.mesh_number() == 1


def test_a_filter_script_in_the_making_is_kept(ms: Any, state: Any) -> None:
    ms.apply_filter("compute_normal_for_point_clouds", k=7)
    _, _, script = state(ms)
    meshlab_sofnn.estimate_normals(ms)
    meshlab_sofnn.reconstruct(ms)
    assert state(ms)[2] == script


def test_every_colour_survives_the_way_through_meshlab() -> None:
    rng = np.random.default_rng(2)
    colors = np.concatenate(
        [np.tile(np.arange(256)[:, None], 4), rng.integers(0, 256, (244, 4))]
    ).astype(np.uint8)
    vertices = rng.normal(size=(500, 3))
    triangles = np.arange(498, dtype=np.int32).reshape(-1, 3)
    ms = pymeshlab.MeshSet()
    layers.add_surface(ms, engine.Surface(vertices, vertices, triangles, np.ones(500), colors, {}))
    np.testing.assert_array_equal(np.rint(ms.current_mesh().vertex_color_matrix() * 255), colors)
    np.testing.assert_array_equal(ms.current_mesh().vertex_normal_matrix(), vertices)


def test_colours_are_mixed_like_every_other_value(ms: Any, points: Any, colors: Any) -> None:
    meshlab_sofnn.reconstruct(ms)
    weights = pipeline.reconstruct_surface(points).source_weights
    expected = np.rint(weights @ colors.astype(np.float64))
    np.testing.assert_array_equal(np.rint(ms.current_mesh().vertex_color_matrix() * 255), expected)


@pytest.mark.parametrize(
    ("params", "options"),
    [
        ({}, {}),
        ({"orientation": "viewpoint", "viewpos": [400, 30, 9]}, {"viewpoint": (400, 30, 9)}),
        ({"orientation": 2, "direction": (1, 0, 0)}, {"towards": (1, 0, 0)}),
        ({"max_nn": 30}, {"max_nn": 30}),
    ],
)
def test_orientation_and_neighbourhood(ms: Any, points: Any, params: Any, options: Any) -> None:
    meshlab_sofnn.estimate_normals(ms, **params)
    options = {k: np.array(v, float) if k != "max_nn" else v for k, v in options.items()}
    np.testing.assert_array_equal(
        ms.current_mesh().vertex_normal_matrix(),
        pipeline.estimate_normals(points, **options).normals,
    )


def test_a_surface_faces_the_viewpoint(ms: Any, points: Any) -> None:
    place = points.mean(axis=0) + np.array([0.0, 0.0, 50.0])
    meshlab_sofnn.reconstruct(ms, orientation="viewpoint", viewpos=place)
    mesh = pipeline.reconstruct_surface(points, viewpoint=place)
    np.testing.assert_array_equal(ms.current_mesh().vertex_matrix(), mesh.vertices)


def test_lengths_are_absolute_or_a_percentage_of_the_diagonal(ms: Any) -> None:
    diagonal = ms.current_mesh().bounding_box().diagonal()
    summary = meshlab_sofnn.reconstruct(ms, voxel_size=pymeshlab.PercentageValue(5))
    assert summary["voxel_size"] == pytest.approx(0.05 * diagonal, rel=1e-6)
    ms.set_current_mesh(0)
    summary = meshlab_sofnn.reconstruct(ms, voxel_size=pymeshlab.PureValue(0.25))
    assert summary["voxel_size"] == 0.25


def test_the_layers_normals_can_be_used(ms: Any, points: Any, state: Any) -> None:
    before = state(ms)
    with pytest.raises(pymeshlab.PyMeshLabException, match="600 of 600 vertices without"):
        meshlab_sofnn.reconstruct(ms, use_normals=True)
    assert state(ms) == before
    meshlab_sofnn.estimate_normals(ms)
    normals = ms.current_mesh().vertex_normal_matrix()
    meshlab_sofnn.reconstruct(ms, use_normals=True)
    assert_is_surface(
        ms.current_mesh(),
        pipeline.reconstruct_surface(points, normals=np.ascontiguousarray(normals)),
    )


def test_vertices_that_are_not_finite(points: Any) -> None:
    broken = np.insert(points, [3, 77], np.nan, axis=0)
    ms = pymeshlab.MeshSet()
    ms.add_mesh(pymeshlab.Mesh(broken))
    assert meshlab_sofnn.estimate_normals(ms)["ignored_points"] == 2
    expected = np.insert(pipeline.estimate_normals(points).normals, [3, 77], 0.0, axis=0)
    np.testing.assert_array_equal(ms.current_mesh().vertex_normal_matrix(), expected)
    assert meshlab_sofnn.reconstruct(ms)["ignored_points"] == 2
    assert_is_surface(ms.current_mesh(), pipeline.reconstruct_surface(points))


@pytest.mark.parametrize("run", [meshlab_sofnn.reconstruct, meshlab_sofnn.estimate_normals])
def test_progress_and_what_it_raises(ms: Any, run: Callable[..., Any], state: Any) -> None:
    fractions: list[float] = []
    before = state(ms)

    def interrupt(fraction: float, text: str) -> None:
        fractions.append(fraction)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(ms, progress=interrupt)
    assert state(ms) == before
    run(ms, progress=lambda fraction, text: fractions.append(fraction))
    assert len(fractions) > 1
    assert all(0 <= fraction <= 1 for fraction in fractions)
