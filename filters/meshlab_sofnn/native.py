"""The bridge to the native MeshLab plugin: its filters call back into this Python process."""

from __future__ import annotations

import ctypes
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pymeshlab
from numpy.typing import NDArray

from meshlab_sofnn.engine import Cloud, given_colors, normals_of_cloud, surface_of_cloud
from meshlab_sofnn.parameters import RECONSTRUCT

INTERFACE_VERSION = 1
PLUGIN_FILE = {"win32": "filter_sofnn.dll", "darwin": "libfilter_sofnn.dylib"}.get(
    sys.platform, "libfilter_sofnn.so"
)


class _Job(ctypes.Structure):
    """``SofnnJob`` of filter_sofnn.h: one call of a native filter."""


_POINTER = ctypes.POINTER(_Job)
_ReportProgress = ctypes.CFUNCTYPE(None, _POINTER, ctypes.c_int, ctypes.c_char_p)
_MakeMesh = ctypes.CFUNCTYPE(None, _POINTER, ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p)
_Finish = ctypes.CFUNCTYPE(None, _POINTER, ctypes.c_char_p, ctypes.c_char_p)
_Engine = ctypes.CFUNCTYPE(None, _POINTER)

_Job._fields_ = [
    ("command", ctypes.c_char_p),
    ("options", ctypes.c_char_p),
    ("scalar_size", ctypes.c_int64),
    ("stride", ctypes.c_int64),
    ("count", ctypes.c_int64),
    ("points", ctypes.c_void_p),
    ("normals", ctypes.c_void_p),
    ("colors", ctypes.c_void_p),
    ("confidence", ctypes.c_void_p),
    ("progress", _ReportProgress),
    ("make_mesh", _MakeMesh),
    ("finish", _Finish),
]

# The plugin that was connected; kept, because PyMeshLab cannot unload one.
_library: ctypes.CDLL | None = None


def installed_plugin() -> Path | None:
    """Return the native plugin's file in this package's folder, or None."""
    path = Path(__file__).with_name(PLUGIN_FILE)
    return path if path.is_file() else None


def connect(path: Path) -> None:
    """Load the native plugin unless it is loaded, and make it call back into this process.

    Parameters
    ----------
    path : Path
        The plugin's file.

    Raises
    ------
    pymeshlab.PyMeshLabException
        No such file, a plugin for another MeshLab, or another version of this interface.
    """
    global _library
    path = path.resolve()
    if not path.is_file():
        raise pymeshlab.PyMeshLabException(f"No such native plugin: {path}")
    if RECONSTRUCT not in pymeshlab.filter_list():
        pymeshlab.load_plugin(str(path))
    library = ctypes.CDLL(str(path))
    version = library.o3d_sofnn_interface_version()
    if version != INTERFACE_VERSION:
        raise pymeshlab.PyMeshLabException(
            f"{path}: expected interface version {INTERFACE_VERSION}, got {version}; "
            "build the plugin from the sources that belong to this package"
        )
    library.o3d_sofnn_set_engine(_engine)
    _library = library


def disconnect() -> None:
    """Let the native filters run the command line program again."""
    if _library is not None:
        _library.o3d_sofnn_set_engine(None)


_CLOSED: dict[str, Any] = {"auto": "auto", "yes": True, "no": False}


def _options(text: str) -> dict[str, Any]:
    """Return the pipeline's keywords for command line options, one item a line."""
    options: dict[str, Any] = {}
    name = ""
    for item in text.splitlines():
        if not item.startswith("--"):
            options[name].append(float(item))
            continue
        option, _, value = item.partition("=")
        name = {"--threads": "n_threads"}.get(option, option[2:].replace("-", "_"))
        if value:
            options[name] = _CLOSED[value] if name == "closed" else json.loads(value)
        else:
            options[name] = [] if name in ("viewpoint", "towards") else True
    return options


def _view(job: Any, field: str, columns: int) -> NDArray[Any]:
    """Return one field of all vertices of MeshLab's array of structures, without a copy."""
    kind: Any = np.uint8 if field == "colors" else f"f{job.scalar_size}"
    item = np.dtype(kind).itemsize
    length = (job.count - 1) * job.stride + columns * item
    memory = (ctypes.c_char * length).from_address(getattr(job, field))
    return np.ndarray((job.count, columns), kind, memory, strides=(job.stride, item))


def _run(pointer: Any) -> None:
    job = pointer.contents
    options = _options(job.options.decode())
    colors = np.ascontiguousarray(_view(job, "colors", 4))
    cloud = Cloud(
        points=_view(job, "points", 3).astype(np.float64),
        normals=_view(job, "normals", 3).astype(np.float64),
        colors=given_colors(colors),
    )

    def progress(fraction: float, text: str) -> None:
        job.progress(pointer, int(100 * fraction), text.encode())

    if job.command == b"reconstruct":
        surface = surface_of_cloud(cloud, {"use_normals": False, **options}, progress)
        triangles = np.ascontiguousarray(surface.triangles, dtype=np.int32)
        job.make_mesh(pointer, len(surface.vertices), len(triangles), triangles.ctypes.data)
        _view(job, "points", 3)[:] = surface.vertices
        _view(job, "normals", 3)[:] = surface.normals
        _view(job, "confidence", 1)[:, 0] = surface.confidence
        if surface.colors is not None:
            _view(job, "colors", 4)[:] = surface.colors
        summary = surface.summary
    else:
        normals, summary = normals_of_cloud(cloud, options, progress)
        job.make_mesh(pointer, len(normals), 0, None)
        _view(job, "normals", 3)[:] = normals
    job.finish(pointer, b"", json.dumps(summary).encode())


def _answer(pointer: Any) -> None:
    # Nothing may leave a C callback: every error becomes the filter's error.
    try:
        _run(pointer)
    except ValueError as error:
        _fail(pointer, str(error))
    except KeyboardInterrupt:
        _fail(pointer, "interrupted")
    except BaseException as error:
        _fail(pointer, f"{type(error).__name__}: {error}")


def _fail(pointer: Any, text: str) -> None:
    pointer.contents.finish(pointer, (text or "failed without a message").encode(), b"{}")


# Kept for as long as the process lives: the plugin holds its address.
_engine = _Engine(_answer)
