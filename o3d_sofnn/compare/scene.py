"""The visible results for one cloud, and their JSON form: few bytes per vertex, as base64."""

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.compare.measure import FIGURES, show
from o3d_sofnn.compare.raster import View, typical_spacing

if TYPE_CHECKING:
    from o3d_sofnn.compare.evaluate import Look

Array = NDArray[Any]
Row = dict[str, Any]

STEPS = 65535
"""Number of steps along each side of the box of a mesh."""


@dataclass(frozen=True)
class Scene:
    """The visible results for one cloud.

    Attributes
    ----------
    title : str
        Title of the cloud.
    view : View
        Initial view.
    looks : dict of str to Look
        Looks of the methods, and of the "input".
    errors : dict of str to str
        Messages of the methods that failed.
    facts : dict of str to str
        A few figures of the other methods.
    """

    title: str
    view: View
    looks: dict[str, Look] = field(default_factory=dict)
    errors: dict[str, str] = field(default_factory=dict)
    facts: dict[str, str] = field(default_factory=dict)

    def add(self, row: Row, look: Look | None) -> None:
        """Add the result of a method."""
        if look is None:
            self.errors[row["method"]] = row["error"]
            return
        key = "input_mean" if row.get("chamfer") is None else "chamfer"
        self.looks[row["method"]] = look
        self.facts[row["method"]] = (
            f"{show('seconds', row['seconds'])} s, {FIGURES[key]} {show(key, row[key])}"
        )


def pack(scene: Scene, titles: dict[str, str]) -> dict[str, Any]:
    """Return one scene: its bounding ball, and a pane for the input and every method."""
    first = scene.looks.get("input")
    boxed = [look for look in (first, *scene.looks.values()) if look is not None]
    box = boxed[0].vertices if boxed else np.zeros((1, 3))
    center = 0.5 * (box.min(axis=0) + box.max(axis=0))
    methods = [*scene.looks, *scene.errors]
    order = sorted(methods, key=list(titles).index)
    return {
        "title": scene.title,
        "axes": scene.view.axes().ravel().tolist(),
        "center": center.tolist(),
        "radius": float(np.linalg.norm(box - center, axis=1).max()),
        "dots": None
        if first is None
        else {**_places(first.vertices), "spacing": typical_spacing(first.vertices)},
        "panes": [
            {"method": method, "title": titles[method], "facts": scene.facts.get(method)}
            | (
                _pane(scene.looks[method])
                if method in scene.looks
                else {"error": scene.errors[method]}
            )
            for method in order
        ],
    }


def _pane(look: Look) -> dict[str, Any]:
    cloud = not len(look.triangles)
    wide = len(look.vertices) > STEPS
    pane: dict[str, Any] = {
        # The points of a cloud are the dots of the scene.
        "mesh": None
        if cloud
        else {
            **_places(look.vertices),
            "triangles": _text(look.triangles, np.uint32 if wide else np.uint16),
            "wide": wide,
            "errors": _text(np.rint(255.0 * look.errors), np.uint8),
        },
        "pictures": {
            name: "data:image/png;base64," + base64.b64encode(data).decode("ascii")
            for name, data in look.pictures.items()
        },
    }
    if look.normals is not None:
        pane["normals"] = _text(np.rint(127.0 * look.normals), np.int8)
    if look.flipped is not None:
        pane["flipped"] = _text(look.flipped, np.uint8)
    return pane


def _places(vertices: Array) -> dict[str, Any]:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    span = np.maximum(high - low, 1e-300)
    return {
        "low": low.tolist(),
        "span": span.tolist(),
        "places": _text(np.rint(STEPS * (vertices - low) / span), np.uint16),
    }


def _text(values: Array, kind: Any) -> str:
    data = np.ascontiguousarray(values).astype(np.dtype(kind).newbyteorder("<"))
    return base64.b64encode(data.tobytes()).decode("ascii")
