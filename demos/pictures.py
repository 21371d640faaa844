"""Rows of pictures: points and meshes from the same view, each with a line of text below."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from o3d_sofnn.compare.raster import Frame, View, depth_colors, draw_mesh, draw_points

Array = NDArray[Any]

FRONT = (0.74, 0.80, 0.88)
"""Colour of meshes without colours of their own."""
INK = (50, 50, 50)
CAPTION = 30
"""Height of the line of text, in pixels."""


@dataclass(frozen=True)
class Panel:
    """One part of a picture: points, or a mesh if there are triangles.

    Attributes
    ----------
    caption : str
        Text below.
    points : (n, 3) array
        Points, or vertices.
    triangles : (f, 3) integer array, optional
        Triangles of a mesh. Their backs are drawn in red.
    colors : (n, 3) array, optional
        Red, green, blue from 0 to 1, one row per point. Without them, points become paler with the
        distance.
    """

    caption: str
    points: Array
    triangles: Array | None = None
    colors: Array | None = None


def draw(
    path: Path,
    panels: list[Panel],
    view: View,
    *,
    height: int = 460,
    columns: int | None = None,
    max_bytes: int | None = None,
) -> Image.Image:
    """Draw panels side by side, all from the same view.

    Parameters
    ----------
    path : Path
        The PNG file to write.
    panels : list of Panel
        Panels from left to right. The first one determines the frame.
    view : View
        View of all panels.
    height : int, default 460
        Height of one panel, in pixels, without its caption.
    columns : int, optional
        Panels per row; None puts all into one row.
    max_bytes : int, optional
        Largest size of the file; colours, then pixels are reduced to reach it.

    Returns
    -------
    PIL.Image.Image
        The picture.
    """
    across, up, _ = np.ptp(panels[0].points @ view.axes().T, axis=0)
    wide = float(np.clip(across / max(up, 1e-12 * across), 0.7, 3.0))
    width = int(height * min(wide, 1.5))
    height = int(min(height, width / wide))
    frame = Frame.around(view, panels[0].points, width, height)
    columns = min(columns or len(panels), len(panels))
    rows = -(-len(panels) // columns)
    whole = Image.new("RGB", (columns * width, rows * (height + CAPTION)), "white")
    for number, panel in enumerate(panels):
        place = (number % columns * width, number // columns * (height + CAPTION))
        image = Image.fromarray(_pixels(frame, panel), "RGBA")
        whole.paste(image, place, image)
        font = ImageFont.load_default(min(17.0, 1.7 * width / max(len(panel.caption), 1)))
        ImageDraw.Draw(whole).text((place[0] + 10, place[1] + height + 4), panel.caption, INK, font)
    save(path, whole, max_bytes)
    return whole


def stack(pictures: list[Image.Image]) -> Image.Image:
    """Return the pictures stacked vertically, as wide as the narrowest."""
    width = min(each.width for each in pictures)
    pictures = [
        each.resize((width, each.height * width // each.width), Image.LANCZOS) for each in pictures
    ]
    whole = Image.new("RGB", (width, sum(each.height for each in pictures)), "white")
    top = 0
    for picture in pictures:
        whole.paste(picture, (0, top))
        top += picture.height
    return whole


def save(path: Path, image: Image.Image, max_bytes: int | None = None) -> None:
    """Write a PNG file of at most ``max_bytes``; colours, then pixels are reduced to reach it."""
    data = _png(image)
    for colors in (256, 128, 64):
        if max_bytes is None or len(data) <= max_bytes:
            break
        data = _png(image.quantize(colors, dither=Image.Dither.NONE))
    while max_bytes is not None and len(data) > max_bytes:
        image = image.resize((image.width * 9 // 10, image.height * 9 // 10), Image.LANCZOS)
        data = _png(image.quantize(128, dither=Image.Dither.NONE))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def _pixels(frame: Frame, panel: Panel) -> NDArray[np.uint8]:
    points = np.ascontiguousarray(panel.points, dtype=np.float64)
    if panel.triangles is not None:
        colors = np.full((len(points), 3), FRONT) if panel.colors is None else panel.colors
        return draw_mesh(frame, points, panel.triangles, colors)
    if panel.colors is None:
        return draw_points(frame, points, depth_colors(frame, points), opaque=False)
    return draw_points(frame, points, np.asarray(panel.colors), opaque=True)


def _png(image: Image.Image) -> bytes:
    stream = io.BytesIO()
    image.save(stream, "PNG", optimize=True)
    return stream.getvalue()
