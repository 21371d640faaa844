"""Progress callbacks that raise, or that change the cloud during the call."""

from __future__ import annotations

import numpy as np
import pytest
import shapes

import o3d_sofnn
from o3d_sofnn import adapters

o3d = pytest.importorskip("open3d")


@pytest.mark.parametrize("kind", [KeyboardInterrupt, StopIteration, GeneratorExit, ValueError])
@pytest.mark.parametrize("after", [0.0, 0.3])
def test_what_the_progress_raises_arrives(family, make_cloud, normals_of, kind, after):
    error = kind("enough")

    def stop(fraction, text):
        if fraction >= after:
            raise error

    cloud = make_cloud(shapes.sphere(300).points, family)
    for operator in (o3d_sofnn.estimate_normals, o3d_sofnn.reconstruct_surface):
        with pytest.raises(kind) as caught:
            operator(cloud, print_progress=stop)
        assert caught.value is error
    assert normals_of(cloud) is None


def changes_of(cloud):
    """Return what a callback could do to a cloud, by name."""
    if isinstance(cloud, o3d.geometry.PointCloud):
        points = o3d.utility.Vector3dVector(np.ones((50_000, 3)))
        return {
            "clear": cloud.clear,
            "longer": lambda: setattr(cloud, "points", points),
            "nan": lambda: np.asarray(cloud.points).fill(np.nan),
        }
    points = o3d.core.Tensor(np.ones((50_000, 3)))
    return {
        "clear": cloud.clear,
        "longer": lambda: setattr(cloud.point, "positions", points),
        "nan": lambda: cloud.point["positions"].numpy().fill(np.nan),
    }


@pytest.mark.parametrize("change", ["clear", "longer", "nan"])
def test_the_cloud_of_the_call_counts(family, make_cloud, normals_of, change):
    small = shapes.sphere(300)

    def changing(cloud):
        return lambda fraction, text: changes_of(cloud)[change]()

    def make():
        return make_cloud(small.points, family, normals=small.normals, colors=np.abs(small.normals))

    expected, _ = adapters.read_mesh(o3d_sofnn.reconstruct_surface(make(), use_normals=True))
    cloud = make()
    mesh = o3d_sofnn.reconstruct_surface(cloud, use_normals=True, print_progress=changing(cloud))
    found, _ = adapters.read_mesh(mesh)
    assert np.array_equal(found.points, expected.points)
    assert np.array_equal(found.attributes["colors"], expected.attributes["colors"])
    cloud = make()
    if change == "nan":
        o3d_sofnn.estimate_normals(cloud, print_progress=changing(cloud))
        normals = adapters.read_cloud(cloud).normals
        assert np.array_equal(
            normals, adapters.read_cloud(o3d_sofnn.estimate_normals(make())).normals
        )
        return
    with pytest.raises(ValueError, match=r"^pcd: changed since the call from 300 to"):
        o3d_sofnn.estimate_normals(cloud, print_progress=changing(cloud))
