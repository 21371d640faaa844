"""Make the filters callable by name, like MeshLab's own."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pymeshlab

from meshlab_sofnn import native
from meshlab_sofnn.filters import estimate_normals, reconstruct, run
from meshlab_sofnn.layers import box_diagonal, point_layer
from meshlab_sofnn.parameters import NORMALS, RECONSTRUCT, parameter_values

PLUGIN_VARIABLE = "MESHLAB_SOFNN_PLUGIN"

_FILTERS = {RECONSTRUCT: reconstruct, NORMALS: estimate_normals}
_WRAPPED = ("apply_filter", "filter_parameter_values")

# What `register` replaced in MeshSet; empty while the Python-level filters are not registered.
_originals: dict[str, Any] = {}


def register(plugin: str | os.PathLike[str] | bool | None = None) -> str:
    """Make both filters callable by name on every ``pymeshlab.MeshSet``.

    Afterwards ``ms.generate_surface_reconstruction_sofnn(...)``,
    ``ms.compute_normal_for_point_clouds_sofnn(...)``, ``ms.apply_filter(name, ...)`` and
    ``ms.filter_parameter_values(name)`` work. With the native plugin the filters are also in
    ``pymeshlab.filter_list()`` and in filter scripts (.mlx). Calling it again changes nothing.

    Parameters
    ----------
    plugin : path, bool or None, default None
        The native plugin's file. None takes the file that the environment variable
        ``MESHLAB_SOFNN_PLUGIN`` names, else one that lies in this package's folder, else
        registers at the Python level. False always registers at the Python level.

    Returns
    -------
    str
        "native" or "python".

    Raises
    ------
    pymeshlab.PyMeshLabException
        The native plugin does not exist or does not fit this PyMeshLab.
    """
    path = None if plugin is False else _plugin_path(plugin)
    if path is not None:
        native.connect(path)
        _unwrap()
    elif not _originals:
        for name in _WRAPPED:
            _originals[name] = getattr(pymeshlab.MeshSet, name)
        pymeshlab.MeshSet.apply_filter = _apply_filter
        pymeshlab.MeshSet.filter_parameter_values = _filter_parameter_values
    for name, function in _FILTERS.items():
        method = pymeshlab.bind_function(name)
        method.__doc__ = function.__doc__
        setattr(pymeshlab.MeshSet, name, method)
    return "python" if path is None else "native"


def unregister() -> None:
    """Take back what `register` did; calling it again changes nothing.

    PyMeshLab cannot unload a native plugin: its filters stay in ``pymeshlab.filter_list()``
    and run the command line program ``o3d-sofnn`` from then on.
    """
    _unwrap()
    native.disconnect()
    for name in _FILTERS:
        if name in vars(pymeshlab.MeshSet):
            delattr(pymeshlab.MeshSet, name)


def _plugin_path(plugin: str | os.PathLike[str] | bool | None) -> Path | None:
    if isinstance(plugin, (str, os.PathLike)):
        return Path(plugin)
    if PLUGIN_VARIABLE in os.environ:
        return Path(os.environ[PLUGIN_VARIABLE])
    found = native.installed_plugin()
    if found is None and plugin is True:
        raise pymeshlab.PyMeshLabException(
            f"No native plugin: expected {PLUGIN_VARIABLE} in the environment or "
            f"{native.PLUGIN_FILE} in {Path(__file__).parent}."
        )
    return found


def _unwrap() -> None:
    for name, original in _originals.items():
        setattr(pymeshlab.MeshSet, name, original)
    _originals.clear()


def _apply_filter(self: pymeshlab.MeshSet, filter_name: str, **kwargs: Any) -> Any:
    if filter_name in _FILTERS:
        return run(self, filter_name, kwargs)
    return _originals["apply_filter"](self, filter_name, **kwargs)


def _filter_parameter_values(self: pymeshlab.MeshSet, filter_name: str, **kwargs: Any) -> Any:
    if filter_name in _FILTERS:
        mesh = point_layer(self, filter_name)
        return parameter_values(filter_name, box_diagonal(mesh), kwargs)
    return _originals["filter_parameter_values"](self, filter_name, **kwargs)
