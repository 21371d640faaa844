"""PLY: ascii and binary of both byte orders, any types and names of properties."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import BinaryIO

import numpy as np

from o3d_sofnn.files import columns, triangles
from o3d_sofnn.files.columns import Array, PointFile
from o3d_sofnn.files.readers.lines import Lines, as_text, check_end, excerpt, read_table
from o3d_sofnn.files.readers.ply_lists import (
    Columns,
    Element,
    List,
    cut_short,
    read_ascii_lists,
    read_lists,
    typed,
)
from o3d_sofnn.files.regular import open_regular, read_records
from o3d_sofnn.files.triangles import Triangles

_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"} | {
    "float": "f4", "double": "f8", "float32": "f4", "float64": "f8", "int8": "i1", "uint8": "u1",
    "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8",
}  # fmt: skip


_COUNTERS = {name: kind for name, kind in _TYPES.items() if kind[0] != "f"}


_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


_FACE_LISTS = ("vertex_indices", "vertex_index")


# The scanner's place as PCL writes it, behind the points.
_CAMERA = ("view_px", "view_py", "view_pz")


_LONGEST_LINE, _LONGEST_NAME = 4096, 255


def read_ply(path: Path) -> PointFile:
    """Read the vertices, and PCL's camera as their viewpoint.

    Raises
    ------
    OSError
        The file cannot be opened.
    ValueError
        No PLY, no vertices with x y z, or cut short.
    """
    values, lists = _read(path, {"vertex", "camera"})
    notes = [f"vertex property {name} left out: a list" for name in lists["vertex"]]
    camera = values.get("camera", {})
    viewpoint = None
    if set(_CAMERA) <= camera.keys() and len(camera["view_px"]) == 1:
        viewpoint = columns.as_viewpoint([camera[name][0] for name in _CAMERA])
    return columns.from_columns(path, values["vertex"], notes, viewpoint=viewpoint)


def read_ply_mesh(path: Path) -> tuple[Array, Triangles]:
    """Read the (m, 3) vertices and (f, 3) triangles; no triangles of a cloud."""
    values, lists = _read(path, {"vertex", "face"})
    points = columns.from_columns(path, values["vertex"]).points
    for name in _FACE_LISTS:
        if name in lists.get("face", {}):
            faces = lists["face"][name]
            found = triangles.from_polygons(faces.counts, faces.values)
            return points, triangles.checked(found, len(points), path)
    return points, np.zeros((0, 3), dtype=np.int64)


def _read(path: Path, wanted: set[str]) -> tuple[dict[str, Columns], dict[str, dict[str, List]]]:
    """Return single values and lists of the wanted elements, which must include vertices."""
    values: dict[str, Columns] = {}
    lists: dict[str, dict[str, List]] = {}
    with open_regular(path) as stream:
        order, elements, number = read_header(stream, path)
        missing = {element.name for element in elements} & wanted
        if "vertex" not in missing:
            raise ValueError(f"{path}: not readable as PLY: no element vertex")
        lines = None if order else Lines(as_text(stream), path, number)
        for element in elements:
            if not missing:
                break
            if lines is not None:
                single, several = _read_ascii(lines, element, path)
            elif element.has_lists:
                single, several = read_lists(stream, element, order, path)
            else:
                single, several = _read_fixed(stream, element, order, path), {}
            if element.name in missing:
                missing.remove(element.name)
                values[element.name], lists[element.name] = single, several
    if not order and elements[-1].name in wanted:
        check_end(path)
    return values, lists


def read_header(stream: BinaryIO, path: Path) -> tuple[str, list[Element], int]:
    """Return the byte order ("" for ascii), the elements, and the number of lines."""
    order: str | None = None
    elements: list[Element] = []
    for number in itertools.count(1):
        line = stream.readline(_LONGEST_LINE)
        words = line.decode(errors="backslashreplace").split()
        try:
            if not line.endswith(b"\n") or (number == 1 and words != ["ply"]):
                raise ValueError
            match words:
                case ["end_header"] if order is not None:
                    return order, elements, number
                case ["format", name, _]:
                    order = _ORDERS[name]
                case ["element", name, count]:
                    elements.append(Element(name, _as_count(count)))
                case ["property", "list", counter, kind, name]:
                    _add_property(elements[-1], name, _TYPES[kind], _COUNTERS[counter])
                case ["property", kind, name]:
                    _add_property(elements[-1], name, _TYPES[kind], None)
                case [] | ["ply" | "comment" | "obj_info", *_]:
                    pass
                case _:
                    raise ValueError
        except (ValueError, KeyError, IndexError):
            text = excerpt(line.decode(errors="backslashreplace"))
            raise ValueError(f"{path}: not readable as PLY: line {number} is {text}") from None
    raise AssertionError("unreachable")


def _as_count(text: str) -> int:
    if not (text.isdecimal() and text.isascii() and len(text) < 19):
        raise ValueError
    return int(text)


def _add_property(element: Element, name: str, kind: str, counter: str | None) -> None:
    if len(name) > _LONGEST_NAME or any(name == known for known, _, _ in element.properties):
        raise ValueError
    element.properties.append((name, kind, counter))


def _read_fixed(stream: BinaryIO, element: Element, order: str, path: Path) -> Columns:
    kind = np.dtype([(name, order + kind) for name, kind, _ in element.properties])
    if kind.itemsize == 0:
        return {}
    records = np.frombuffer(read_records(stream, path, element.count, kind.itemsize), dtype=kind)
    return {name: records[name] for name, _, _ in element.properties}


def _read_ascii(lines: Lines, element: Element, path: Path) -> tuple[Columns, dict[str, List]]:
    rows = itertools.islice((line for line in lines if not line.isspace()), element.count)
    if element.has_lists:
        return read_ascii_lists(rows, lines, element, path)
    width = len(element.properties)
    table = read_table(rows, width, lines) if width else np.zeros((0, 0))
    if width and len(table) < element.count:
        raise cut_short(path, element, len(table))
    return {
        name: typed(table[:, i], kind, f"{path}: property {name}")
        for i, (name, kind, _) in enumerate(element.properties)
    }, {}
