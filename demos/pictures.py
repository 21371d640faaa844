"""Pictures of points, normals and meshes without a screen: PyVista into PNG files."""

from __future__ import annotations

import ctypes
import io
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

NEAR = (0.10, 0.18, 0.36)
FAR = (0.80, 0.85, 0.92)
FRONT = (0.72, 0.78, 0.86)
BACK = (0.86, 0.45, 0.36)
INK = (0.2, 0.2, 0.2)
MARGIN = 1.06
"""Of the picture about the object, as a factor."""
CAPTION = 34
"""Height of the line of text under a panel, in pixels."""


@dataclass(frozen=True)
class Panel:
    """One pane of a picture: points, or a mesh when there are triangles.

    Attributes
    ----------
    caption : str
        Text under the pane.
    points : (n, 3) array
        Points, or vertices.
    triangles : (f, 3) integer array, optional
        Of a mesh. Backs of triangles are drawn in red.
    colors : (n, 3) array, optional
        Red, green, blue from 0 to 1, one row a point. Points without: paler with the distance.
    normals : (n, 3) array, optional
        Smooth shading of a mesh; flat without them.
    """

    caption: str
    points: Array
    triangles: Array | None = None
    colors: Array | None = None
    normals: Array | None = None


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


def direction_colors(normals: Array) -> Array:
    """Colour unit vectors by their direction: x red, y green, z blue."""
    return 0.5 + 0.5 * np.asarray(normals)


def heat_colors(values: Array, largest: float) -> Array:
    """Colour numbers from 0 (pale) to ``largest`` and beyond (dark red)."""
    share = np.clip(np.asarray(values) / largest, 0.0, 1.0)
    stops = np.array([[0.93, 0.94, 0.96], [0.99, 0.80, 0.45], [0.90, 0.33, 0.20], [0.45, 0.0, 0.1]])
    place = np.linspace(0.0, 1.0, len(stops))
    return np.stack([np.interp(share, place, stops[:, k]) for k in range(3)], axis=1)


def import_pyvista() -> Any:
    """Return the module ``pyvista``, set up for a machine that may have no screen.

    Raises
    ------
    RuntimeError
        No screen, and no library that draws without one; the message says what to type.
    """
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        # VTK would try an X server first, and complain, and end the process if all attempts fail.
        for window, libraries in (
            ("vtkEGLRenderWindow", ("libEGL.so.1",)),
            ("vtkOSOpenGLRenderWindow", ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so")),
        ):
            if any(_loads(library) for library in libraries):
                os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", window)
                break
        else:
            raise RuntimeError(
                "nothing here can draw without a screen; on Debian or Ubuntu type: "
                "apt-get install libegl1"
            )
    import pyvista

    pyvista.OFF_SCREEN = True
    return pyvista


def draw(
    path: Path,
    panels: list[Panel],
    view: View,
    *,
    height: int = 560,
    width: int | None = None,
    columns: int | None = None,
    max_bytes: int | None = None,
) -> Path:
    """Draw panels side by side, all from the same place.

    Parameters
    ----------
    path : Path
        The PNG file to write.
    panels : list of Panel
        From left to right.
    view : View
        Common to all panels. The first panel decides what fits in.
    height : int, default 560
        Of one panel, in pixels, without its caption.
    width : int, optional
        Of one panel, in pixels; None follows the shape of the object.
    columns : int, optional
        Panels a row; None puts all into one.
    max_bytes : int, optional
        Size of the file that is not exceeded: colours, then pixels are saved.

    Returns
    -------
    Path
        ``path``.
    """
    pyvista = import_pyvista()
    columns = min(columns or len(panels), len(panels))
    rows = -(-len(panels) // columns)
    local = panels[0].points @ view.axes().T
    low, high = local.min(axis=0), local.max(axis=0)
    extent = MARGIN * np.maximum(high - low, 1e-12)
    if width is None:
        wide = float(np.clip(extent[0] / extent[1], 0.45, 3.0))
        width = int(height * min(wide, 1.6))
        height = int(min(height, width / wide))
    center = 0.5 * (low + high) @ view.axes()
    scale = 0.5 * max(extent[1], extent[0] * height / width)
    plotter = pyvista.Plotter(
        shape=(rows, columns),
        off_screen=True,
        border=False,
        window_size=(columns * width, rows * (height + CAPTION)),
    )
    for number, panel in enumerate(panels):
        plotter.subplot(number // columns, number % columns)
        plotter.set_background("white")
        _add(plotter, pyvista, panel, view, np.sqrt(width * height * 0.5))
        plotter.add_text(
            panel.caption, position=(8, 6), font_size=min(11, 3 + width // 45), color=INK
        )
        shift = view.axes()[1] * scale * CAPTION / height
        eye = center + view.axes()[2] * 4.0 * np.linalg.norm(extent)
        plotter.camera_position = [tuple(eye - shift), tuple(center - shift), view.up]
        plotter.camera.parallel_projection = True
        plotter.camera.parallel_scale = scale * (height + CAPTION) / height
        plotter.reset_camera_clipping_range()
    pixels = plotter.screenshot(return_img=True)
    plotter.close()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(_encode(pixels, max_bytes))
    return path


def _add(plotter: Any, pyvista: Any, panel: Panel, view: View, pixels: float) -> None:
    points = np.ascontiguousarray(panel.points, dtype=np.float64)
    if panel.triangles is None:
        cloud = pyvista.PolyData(points)
        size = float(np.clip(1.1 * pixels / np.sqrt(max(len(points), 1)), 2.0, 7.0))
        colors = _depth_colors(points, view) if panel.colors is None else panel.colors
        cloud["colors"] = _bytes(colors)
        plotter.add_mesh(
            cloud,
            scalars="colors",
            rgb=True,
            point_size=size,
            render_points_as_spheres=True,
            ambient=0.4,
        )
        return
    faces = np.column_stack([np.full(len(panel.triangles), 3), panel.triangles]).ravel()
    mesh = pyvista.PolyData(points, faces)
    look: dict[str, Any] = {"color": FRONT}
    if panel.colors is not None:
        mesh["colors"] = _bytes(panel.colors)
        look = {"scalars": "colors", "rgb": True}
    smooth = panel.normals is not None
    if smooth:
        mesh.point_data.active_normals = np.ascontiguousarray(panel.normals, dtype=np.float32)
    back = None if panel.colors is not None else {"color": BACK}
    plotter.add_mesh(
        mesh, smooth_shading=smooth, ambient=0.15, specular=0.15, backface_params=back, **look
    )


def _depth_colors(points: Array, view: View) -> Array:
    """Paler with the distance: the far side shows through between points."""
    depth = points @ view.axes()[2]
    near, far = np.quantile(depth, [0.98, 0.02])
    share = np.clip((near - depth) / max(near - far, 1e-12), 0.0, 1.0)[:, None]
    return (1.0 - share) * np.asarray(NEAR) + share * np.asarray(FAR)


def _bytes(colors: Array) -> NDArray[np.uint8]:
    return np.rint(255.0 * np.clip(colors, 0.0, 1.0)).astype(np.uint8)


def stack(path: Path, pictures: list[Path], *, max_bytes: int | None = None) -> Path:
    """Put pictures of the same width below each other into one PNG file."""
    from PIL import Image

    images = [np.asarray(Image.open(picture).convert("RGB")) for picture in pictures]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(_encode(np.concatenate(images), max_bytes))
    return path


def _encode(pixels: Array, max_bytes: int | None) -> bytes:
    from PIL import Image

    image = Image.fromarray(pixels)
    data = _png(image)
    for colors in (256, 128, 64):
        if max_bytes is None or len(data) <= max_bytes:
            return data
        data = _png(image.quantize(colors, dither=Image.Dither.NONE))
    while len(data) > max_bytes:
        image = image.resize((image.width * 9 // 10, image.height * 9 // 10), Image.LANCZOS)
        data = _png(image.quantize(128, dither=Image.Dither.NONE))
    return data


def _png(image: Any) -> bytes:
    stream = io.BytesIO()
    image.save(stream, "PNG", optimize=True)
    return stream.getvalue()


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
