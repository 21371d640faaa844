"""The clouds of the demos: models from the pymeshlab wheel, and degraded copies of them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.compare.raster import View
from o3d_sofnn.geometry import mesh_properties

Array = NDArray[Any]


@dataclass(frozen=True)
class Cloud:
    """Points to reconstruct, and a view of them.

    Attributes
    ----------
    name : str
        Name of the cloud and of the files that are written.
    points : (n, 3) float64
        Points in the unit of the source.
    colors : (n, 3) float64, optional
        Colours from 0 to 1.
    view : View
        View of the pictures.
    trim : float, optional
        Option of ``reconstruct_surface`` for sheets with borders.
    """

    name: str
    points: Array
    colors: Array | None = None
    view: View = field(default_factory=View)
    trim: float | None = None

    def open3d(self) -> Any:
        """Return an ``open3d.geometry.PointCloud``."""
        import open3d as o3d

        pcd = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(self.points))
        if self.colors is not None:
            pcd.colors = o3d.utility.Vector3dVector(self.colors)
        return pcd

    def thinned(self, count: int, seed: int = 0) -> Cloud:
        """Keep ``count`` points, drawn at random, in their order."""
        if count >= len(self.points):
            return self
        keep = np.sort(np.random.default_rng(seed).choice(len(self.points), count, replace=False))
        colors = None if self.colors is None else self.colors[keep]
        return replace(self, points=self.points[keep], colors=colors)

    @property
    def diagonal(self) -> float:
        """Length of the diagonal of the bounding box."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


MODELS = {
    "bunny": ("bunny.obj", View((0.2, 0.25, 1.0), (0.0, 1.0, 0.0))),
    "cow": ("cow.obj", View((-1.0, 0.25, 0.5), (0.0, 1.0, 0.0))),
    "bone": ("bone.ply", View((0.0, 0.3, 1.0), (0.0, 1.0, 0.0))),
}
"""Closed models of the wheel: file and view."""
CHAMELEON_VIEW = View((1.0, 0.25, 0.2), (0.0, 1.0, 0.0))
FACE_VIEW = View((0.25, 0.05, 1.0), (0.0, 1.0, 0.0))


def sample_folder() -> Path:
    """Return the folder of the models that come with pymeshlab."""
    import pymeshlab

    return Path(pymeshlab.__file__).parent / "tests" / "sample_meshes"


def read_model(name: str) -> tuple[Array, Array, Array | None]:
    """Read vertices, triangles and colours (None if there are none) through pymeshlab.

    Raises
    ------
    RuntimeError
        A part of pymeshlab does not load; the message says what to type.
    """
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    try:
        meshes.load_new_mesh(str(sample_folder() / name))
    except pymeshlab.PyMeshLabException as error:
        # If a system library is missing, pymeshlab continues without its readers, after a warning.
        raise RuntimeError(
            f"{name}: {error}; on Debian or Ubuntu type: apt-get install libopengl0"
        ) from error
    mesh = meshes.current_mesh()
    colors = mesh.vertex_color_matrix()[:, :3]
    # Models without colours are white; copies, since the arrays are not in C order.
    return (
        np.array(mesh.vertex_matrix(), order="C"),
        np.array(mesh.face_matrix(), order="C"),
        None if (colors == 1.0).all() else np.array(colors, order="C"),
    )


def chameleon() -> Cloud:
    """Return 4594 coloured points of a chameleon, in a format that Open3D does not read."""
    points, _, colors = read_model("chameleon.pts")
    return Cloud("chameleon", points, colors, CHAMELEON_VIEW)


def face() -> Cloud:
    """Return one range scan of a head, 86 thousand points: an open sheet with holes."""
    points, _, _ = read_model("rangemaps/face000.ply")
    return Cloud("face", points, view=FACE_VIEW, trim=0.5)


def bunny(count: int, seed: int = 0) -> Cloud:
    """Return points drawn uniformly from the bunny."""
    return model("bunny", count, seed)


def model(name: str, count: int, seed: int = 0) -> Cloud:
    """Return points drawn uniformly from one of ``MODELS``."""
    file, view = MODELS[name]
    vertices, triangles, _ = read_model(file)
    points, _ = mesh_properties.sample_surface(vertices, triangles, count, seed)
    return Cloud(name, points, view=view)


def with_colors(cloud: Cloud) -> Cloud:
    """Paint stripes on the points, orange and blue across the picture, darker upwards."""
    across, up, _ = (cloud.points @ cloud.view.axes().T / cloud.diagonal).T
    share = 0.5 + 0.5 * np.sin(60.0 * across + 4.0 * np.sin(25.0 * up))[:, None]
    colors = share * [0.90, 0.55, 0.20] + (1.0 - share) * [0.20, 0.40, 0.65]
    return replace(cloud, colors=colors * (1.0 - 0.4 * (up - up.min()) / np.ptp(up))[:, None])


def with_noise(cloud: Cloud, sigma: float, seed: int = 1) -> Cloud:
    """Move every point by Gaussian noise; ``sigma`` is a fraction of the diagonal."""
    rng = np.random.default_rng(seed)
    return replace(
        cloud, points=cloud.points + rng.normal(0.0, sigma * cloud.diagonal, cloud.points.shape)
    )


def with_outliers(cloud: Cloud, share: float, seed: int = 2) -> Cloud:
    """Add points anywhere in a box 1.2 times as large, ``share`` of the points of the cloud."""
    rng = np.random.default_rng(seed)
    low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
    count = int(share * len(cloud.points))
    stray = 0.5 * (low + high) + 0.6 * (high - low) * rng.uniform(-1.0, 1.0, (count, 3))
    return replace(cloud, points=np.concatenate([cloud.points, stray]), colors=None)


def with_holes(cloud: Cloud, radius: float, count: int = 4, seed: int = 3) -> Cloud:
    """Cut balls out of the visible side of the cloud; ``radius`` is a fraction of the diagonal."""
    rng = np.random.default_rng(seed)
    depth = cloud.points @ np.asarray(cloud.view.axes()[2])
    seen = np.flatnonzero(depth > np.quantile(depth, 0.7))
    keep = np.ones(len(cloud.points), bool)
    for center in cloud.points[rng.choice(seen, count, replace=False)]:
        keep &= np.linalg.norm(cloud.points - center, axis=1) > radius * cloud.diagonal
    return replace(cloud, points=cloud.points[keep], colors=None)


def with_uneven_density(cloud: Cloud, seed: int = 4) -> Cloud:
    """Thin the points from one side of the picture to the other, down to a fortieth."""
    rng = np.random.default_rng(seed)
    across = cloud.points @ np.asarray(cloud.view.axes()[0])
    share = (across - across.min()) / np.ptp(across)
    keep = rng.random(len(cloud.points)) < 40.0 ** (-share)
    return replace(cloud, points=cloud.points[keep], colors=None)


def several_objects(count: int) -> Cloud:
    """Return a bunny, a cow and a bone beside each other."""
    parts, edge = [], 0.0
    for name in ("bunny", "cow", "bone"):
        part = model(name, count // 3)
        local = (part.points - part.points.mean(axis=0)) @ part.view.axes().T
        local /= np.linalg.norm(np.ptp(local, axis=0))
        local[:, 0] += edge - local[:, 0].min()
        edge = local[:, 0].max() + 0.12
        parts.append(local)
    view = View((0.0, 0.2, 1.0), (0.0, 1.0, 0.0))
    return Cloud("several", np.concatenate(parts), view=view)
