"""Pictures of points, by plain array code, and of meshes, by Open3D's rays: no screen is needed."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from o3d_sofnn.adapters import import_open3d
from o3d_sofnn.geometry.vectors import unit

Array = NDArray[Any]

SUPERSAMPLING = 2
"""Number of samples along each side of a pixel."""
MARGIN = 1.08
"""Size of the picture, divided by the size of its content."""
NEAR, FAR = np.array([0.20, 0.33, 0.58]), np.array([0.72, 0.78, 0.87])
"""Colours of points without colours of their own."""
BACK = np.array([0.80, 0.42, 0.34])
"""Colour of the backs of triangles."""
LIGHT = np.array([0.35, 0.45, 0.82])
"""Direction to the light in the viewer's coordinates: right, up, toward."""
MOST_SAMPLES = 4_000_000
"""Largest number of samples of discs in memory at a time."""


@dataclass(frozen=True)
class View:
    """Where the viewer stands: ``toward`` leads from the object to the eye, ``up`` is up."""

    toward: tuple[float, float, float] = (0.6, -1.0, 0.45)
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def axes(self) -> Array:
        """Return right, up and toward as the rows of an orthonormal matrix."""
        toward = np.asarray(self.toward) / np.linalg.norm(self.toward)
        right = np.cross(self.up, toward)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(toward, right), toward])


@dataclass(frozen=True)
class Frame:
    """The view and bounds of a picture, and its size in pixels.

    Attributes
    ----------
    view : View
        View direction.
    low, high : (3,) float64
        Bounds of the content, along the axes of the view.
    width, height : int
        Size of the picture.
    """

    view: View
    low: Array
    high: Array
    width: int = 480
    height: int = 400

    @classmethod
    def around(cls, view: View, points: Array, width: int = 480, height: int = 400) -> Frame:
        """Return the smallest frame that contains (n, 3) points."""
        seen = points @ view.axes().T
        return cls(view, seen.min(axis=0), seen.max(axis=0), width, height)

    def project(self, points: Array) -> Array:
        """Return columns and rows in pixels from the upper left corner, and depth, (n, 3)."""
        middle, scale = self._fit()
        local = (points @ self.view.axes().T - middle) * scale
        return np.column_stack(
            [0.5 * self.width + local[:, 0], 0.5 * self.height - local[:, 1], local[:, 2]]
        )

    def pixels(self, length: float) -> float:
        """Return the number of pixels of a length across the view."""
        return length * self._fit()[1]

    def _fit(self) -> tuple[Array, float]:
        """Return the middle along the axes of the view, and the pixels per unit of length."""
        largest = float(np.abs([self.low, self.high]).max())
        extent = MARGIN * np.maximum(self.high - self.low, 1e-12 * largest + 1e-300)
        scale = min(self.width / extent[0], self.height / extent[1])
        return 0.5 * (self.low + self.high), float(scale)


def draw_mesh(frame: Frame, vertices: Array, triangles: Array, colors: Array) -> NDArray[np.uint8]:
    """Draw a mesh, its backs in one colour.

    Parameters
    ----------
    frame : Frame
        View and size.
    vertices : (m, 3) float64
        In any unit.
    triangles : (f, 3) integer
        Vertex indices.
    colors : (m, 3) float64
        Red, green, blue from 0 to 1 at the vertices.

    Returns
    -------
    numpy.ndarray, shape (height, width, 4), uint8
        Red, green, blue, opacity.
    """
    size = SUPERSAMPLING
    width, height = size * frame.width, size * frame.height
    place = frame.project(vertices) * [size, size, 1.0]
    corners = place[triangles]
    low, high = corners[:, :, :2].min(axis=1), corners[:, :, :2].max(axis=1)
    seen = np.flatnonzero((high > 0).all(axis=1) & (low < [width, height]).all(axis=1))
    picture = np.zeros((height * width, 4))
    if len(seen):
        corners = corners[seen]
        hit, triangle, weights = _cast(corners, (width, height))
        colors = colors[triangles[seen[triangle]]]
        picture[hit, :3] = np.einsum("rk,rkc->rc", weights, _shade(corners[triangle], colors))
        picture[hit, 3] = 1.0
    return _reduce(picture.reshape(height, width, 4), size)


def draw_points(frame: Frame, points: Array, colors: Array, *, opaque: bool) -> NDArray[np.uint8]:
    """Draw points as discs.

    Parameters
    ----------
    frame : Frame
        View and size.
    points : (n, 3) float64
        In any unit.
    colors : (n, 3) float64
        Red, green, blue from 0 to 1.
    opaque : bool
        Whether the discs are so large that the near side hides the far one.

    Returns
    -------
    numpy.ndarray, shape (height, width, 4), uint8
        Red, green, blue, opacity.
    """
    size = SUPERSAMPLING
    place = frame.project(points)
    place[:, :2] *= size
    width, height = size * frame.width, size * frame.height
    part = 0.8 if opaque else 0.2
    radius = size * float(np.clip(part * frame.pixels(typical_spacing(points)), 0.6, 9.0))
    steps = np.arange(-int(radius), int(radius) + 1)
    shift = np.stack(np.meshgrid(steps, steps), -1).reshape(-1, 2)
    shift = shift[(shift**2).sum(axis=1) <= radius**2]
    depth = np.full(width * height, -np.inf)
    picture = np.zeros((width * height, 4))
    part = max(1, MOST_SAMPLES // len(shift))
    for start in range(0, len(points), part):
        rows = slice(start, start + part)
        samples = np.repeat(place[rows, None], len(shift), axis=1)
        samples[:, :, :2] += shift
        _deposit(
            depth,
            picture,
            (width, height),
            samples.reshape(-1, 3),
            np.repeat(colors[rows], len(shift), axis=0),
        )
    return _reduce(picture.reshape(height, width, 4), size)


def typical_spacing(points: Array) -> float:
    """Return the median distance of (n, 3) points from their sixth neighbours."""
    count = min(7, len(points))
    chosen = points[:: max(1, len(points) // 2000)]
    return float(np.median(cKDTree(points).query(chosen, count)[0][:, -1])) if count > 1 else 0.0


def depth_colors(frame: Frame, points: Array) -> Array:
    """Return colours that become paler with the distance, since the far side shows through."""
    depth = points @ frame.view.axes()[2]
    near, far = np.quantile(depth, [0.98, 0.02])
    share = np.clip((near - depth) / max(near - far, 1e-300), 0.0, 1.0)[:, None]
    return np.asarray((1.0 - share) * NEAR + share * FAR)


def encode_png(pixels: NDArray[np.uint8]) -> bytes:
    """Return (height, width, 4) pixels in the PNG format (ISO/IEC 15948)."""
    height, width = pixels.shape[:2]
    # Filter 2, the difference from the row above: smooth shading packs better.
    rows = np.diff(pixels, axis=0, prepend=np.zeros_like(pixels[:1])).reshape(height, -1)
    data = np.column_stack([np.full(height, 2, np.uint8), rows]).tobytes()
    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    parts = [(b"IHDR", header), (b"IDAT", zlib.compress(data, 9)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        for kind, body in parts
    )


def _shade(corners: Array, colors: Array) -> Array:
    """Return the lit colours at the corners of triangles in the viewer's coordinates."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    # Rows grow downwards, which mirrors the picture and turns the normals.
    normals = unit(np.cross(b - a, c - a) * [-1.0, 1.0, -1.0])
    back = normals[:, 2] < 0
    lit = np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
    own = np.where(back[:, None, None], BACK, colors)
    return np.asarray(own * (0.45 + 0.6 * lit)[:, None, None])


def _cast(corners: Array, size: tuple[int, int]) -> tuple[Array, Array, Array]:
    """Return the samples that show a triangle, which triangle, and the weights of its corners.

    Corners are (f, 3, 3): columns and rows of samples, and depth. Open3D's rays (Embree's) look
    along the depth from in front of all triangles, one through the middle of each sample.
    """
    o3d = import_open3d()
    width, height = size
    front = corners[:, :, 2].max()
    scene = o3d.t.geometry.RaycastingScene()
    places = (corners - [0.0, 0.0, front]).reshape(-1, 3).astype(np.float32)
    index = np.arange(len(places), dtype=np.uint32).reshape(-1, 3)
    scene.add_triangles(o3d.core.Tensor(places), o3d.core.Tensor(index))
    rows, columns = np.divmod(np.arange(height * width, dtype=np.int64), width)
    rays = np.zeros((height * width, 6), np.float32)
    rays[:, 0], rays[:, 1], rays[:, 2], rays[:, 5] = columns + 0.5, rows + 0.5, 1.0, -1.0
    found = scene.cast_rays(o3d.core.Tensor(rays))
    hit = np.flatnonzero(np.isfinite(found["t_hit"].numpy()))
    u, v = found["primitive_uvs"].numpy()[hit].astype(np.float64).T
    triangle = found["primitive_ids"].numpy()[hit].astype(np.int64)
    return hit, triangle, np.column_stack([1.0 - u - v, u, v])


def _deposit(
    depth: Array, picture: Array, size: tuple[int, int], samples: Array, colors: Array
) -> None:
    """Write the samples that are nearer than those already in the picture."""
    width, height = size
    column, row = np.floor(samples[:, 0]).astype(int), np.floor(samples[:, 1]).astype(int)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    pixel = (row * width + column)[inside]
    nearness = samples[inside, 2]
    before = depth[pixel]
    np.maximum.at(depth, pixel, nearness)
    wins = (nearness == depth[pixel]) & (nearness > before)
    picture[pixel[wins], :3] = colors[inside][wins]
    picture[pixel[wins], 3] = 1.0


def _reduce(picture: Array, size: int) -> NDArray[np.uint8]:
    """Return the mean over blocks of samples; colours count where there is something."""
    height, width = picture.shape[0] // size, picture.shape[1] // size
    picture[:, :, :3] *= picture[:, :, 3:]
    mean = picture.reshape(height, size, width, size, 4).mean(axis=(1, 3))
    mean[:, :, :3] /= np.maximum(mean[:, :, 3:], 1e-12)
    return np.asarray(np.rint(255.0 * np.clip(mean, 0.0, 1.0)), np.uint8)
