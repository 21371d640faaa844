"""A contact sheet: points, our mesh and Open3D's chain from three sides, with figures below."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pictures
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial import cKDTree

from o3d_sofnn.compare.raster import Frame, View, draw_mesh, draw_points

Array = NDArray[Any]

AROUND = (View((0.6, -1.0, 0.45)), View((-1.0, 0.35, 0.3)), View((0.1, -0.25, 1.0)))
"""From the front, the left, and above: views of surfaces that are visible from all sides."""
ONE_SIDED = 0.25
"""Length of the mean normal above which a surface shows one side, and is viewed from there."""
TURN = 0.6
"""Angle to its other views, in radians."""
INVENTED = (0.98, 0.80, 0.15)
"""Colour of surface that is farther than ``FAR`` times the spacing there from any point."""
FAR, AROUND_POINT = 5.0, 24
"""Neighbours that tell the spacing: enough to reach the next scan lines."""
INK = (0.25, 0.33, 0.45)
MOST_POINTS = 60_000
"""Largest number of points that are drawn."""
SIDE, TEXT = 230, 44
"""Width of a picture and height of the text, in pixels."""
TRIMMED = 0.01
"""Share of the points left out at each end of each axis when the picture is framed: otherwise a few
distant ones would make everything else tiny."""


@dataclass(frozen=True)
class Part:
    """A third of a row: points, or a mesh if there are triangles, and a line of text."""

    caption: str
    points: Array
    triangles: Array | None = None


def views_of(normals: Array) -> tuple[View, ...]:
    """Choose three views of points with normals (n, 3): around them, or of the side they show."""
    mean = normals.mean(axis=0)
    length = float(np.linalg.norm(mean))
    if length < ONE_SIDED:
        return AROUND
    front = mean / length
    up = np.array([0.0, 0.0, 1.0]) if abs(front[2]) < 0.8 else np.array([0.0, 1.0, 0.0])
    right = np.cross(up, front)
    right /= np.linalg.norm(right)
    c, s = np.cos(TURN), np.sin(TURN)
    ways = (front, c * front + s * right, c * front - 0.7 * s * right + 0.7 * s * up)
    return tuple(View(tuple(way), tuple(up)) for way in ways)


def draw_row(title: str, cloud: Array, views: tuple[View, ...], parts: list[Part]) -> Image.Image:
    """Draw one scan.

    Parameters
    ----------
    title : str
        Text above the row.
    cloud : (n, 3) float64
        Points; surface far from all of them is drawn in yellow.
    views : tuple of View
        Pictures of each part.
    parts : list of Part
        From left to right.

    Returns
    -------
    PIL.Image.Image
        The row; backs of triangles are red.
    """
    low, high = np.quantile(cloud, [TRIMMED, 1.0 - TRIMMED], axis=0)
    inside = ((cloud >= low) & (cloud <= high)).all(axis=1)
    framed = cloud[inside] if inside.any() else cloud
    width = SIDE * len(views)
    whole = Image.new("RGB", (width * len(parts), SIDE + TEXT), "white")
    ink = ImageDraw.Draw(whole)
    ink.text((6, 2), title, (0, 0, 0), ImageFont.load_default(15.0))
    tree = cKDTree(cloud)
    near = min(AROUND_POINT, len(cloud))
    spacing = tree.query(cloud, [near], workers=-1)[0][:, 0] * np.sqrt(np.pi / near)
    for column, part in enumerate(parts):
        colors = _colors(part, tree, spacing)
        for number, view in enumerate(views):
            frame = Frame.around(view, framed, SIDE, SIDE)
            image = Image.fromarray(_pixels(frame, part, colors), "RGBA")
            whole.paste(image, (column * width + number * SIDE, TEXT // 2), image)
        place = (column * width + 6, SIDE + TEXT // 2 + 1)
        ink.text(place, part.caption, (60, 60, 60), ImageFont.load_default(13.0))
    return whole


def save(path: Path, rows: list[Image.Image], max_bytes: int | None = None) -> None:
    """Write rows below each other as a PNG file."""
    pictures.save(path, pictures.stack(rows), max_bytes)


def _colors(part: Part, tree: cKDTree, spacing: Array) -> Array:
    colors = np.full((len(part.points), 3), INK if part.triangles is None else pictures.FRONT)
    if part.triangles is not None:
        distance, nearest = tree.query(part.points, workers=-1)
        colors[distance > FAR * spacing[nearest]] = INVENTED
    return colors


def _pixels(frame: Frame, part: Part, colors: Array) -> NDArray[np.uint8]:
    points = np.ascontiguousarray(part.points, np.float64)
    if part.triangles is not None:
        return draw_mesh(frame, points, part.triangles, colors)
    some = slice(None, None, 1 + len(points) // MOST_POINTS)
    return draw_points(frame, points[some], colors[some], opaque=False)
