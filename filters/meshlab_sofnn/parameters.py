"""The filters' names, their parameters in MeshLab's types, and what PyMeshLab users may pass."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pymeshlab

from o3d_sofnn import validation

RECONSTRUCT = "generate_surface_reconstruction_sofnn"
NORMALS = "compute_normal_for_point_clouds_sofnn"

ORIENTATIONS = ("automatic", "viewpoint", "direction")
CLOSINGS = ("auto", "yes", "no")
"""Names of the choices of the enumerations; the first one is the default."""


class InvalidEnum(pymeshlab.PyMeshLabException, pymeshlab.InvalidEnumException):  # type: ignore[misc]
    """An enumeration value that does not exist.

    PyMeshLab raises the second class, which is no kind of the first; this one is both.
    """


@dataclass(frozen=True)
class Parameter:
    """One parameter of a filter.

    Attributes
    ----------
    name : str
        Lower-case keyword, the same as in the native plugin.
    kind : {"bool", "int", "level", "length", "enum", "closing", "point"}
        MeshLab's type; a "length" is given as ``PercentageValue`` (of the diagonal of the
        layer's bounding box) or ``PureValue`` (in the cloud's unit), a "level" as a number or
        "auto".
    default : object
        0 and 0 % stand for "chosen automatically".
    """

    name: str
    kind: str
    default: Any


_COMMON = (
    Parameter("orientation", "enum", 0),
    Parameter("viewpos", "point", (0.0, 0.0, 0.0)),
    Parameter("direction", "point", (0.0, 0.0, 1.0)),
    Parameter("max_nn", "int", 0),
    Parameter("radius", "length", 0.0),
    Parameter("n_threads", "int", -1),
)

PARAMETERS: dict[str, tuple[Parameter, ...]] = {
    RECONSTRUCT: (
        Parameter("depth", "int", 0),
        Parameter("voxel_size", "length", 0.0),
        Parameter("use_normals", "bool", False),
        Parameter("closed", "closing", 0),
        Parameter("trim", "level", 0.0),
        Parameter("target_triangles", "int", 0),
        Parameter("precision", "length", 0.0),
        *_COMMON,
    ),
    NORMALS: _COMMON,
}


def parameter_values(filter_name: str, diagonal: float, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return every parameter of a filter with the value it would run with.

    Parameters
    ----------
    filter_name : str
        `RECONSTRUCT` or `NORMALS`.
    diagonal : float
        Diagonal of the bounding box of the current layer, its matrix applied: 100 %.
    given : mapping
        What the user passed.

    Returns
    -------
    dict
        As ``MeshSet.filter_parameter_values`` gives it: lengths absolute in the cloud's unit,
        enumerations as numbers, points as ``(3,)`` arrays.

    Raises
    ------
    pymeshlab.PyMeshLabException
        An unknown parameter or a value of the wrong type; `InvalidEnum` for an enumeration value
        that does not exist.
    """
    known = {parameter.name: parameter for parameter in PARAMETERS[filter_name]}
    for name in given:
        if name not in known:
            raise pymeshlab.PyMeshLabException(
                f"Parameter {name} not found for filter {filter_name}. "
                f"Expected one of: {', '.join(known)}."
            )
    values = {}
    for name, parameter in known.items():
        if name not in given:
            default = parameter.default
            values[name] = np.array(default) if parameter.kind == "point" else default
        elif parameter.kind == "length":
            values[name] = _length(name, given[name], diagonal)
        else:
            values[name] = _CONVERT[parameter.kind](name, given[name])
    return values


def pipeline_options(filter_name: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of ``o3d_sofnn.options.Options`` for a filter's parameter values.

    Parameters
    ----------
    filter_name : str
        `RECONSTRUCT` or `NORMALS`.
    values : mapping
        From `parameter_values`.

    Returns
    -------
    dict
        Only what the user chose: a parameter left at its automatic value is absent. The
        native plugin hands over the same dictionary.
    """
    automatic = ["max_nn", "radius"]
    if filter_name == RECONSTRUCT:
        automatic += ["depth", "voxel_size", "trim", "target_triangles", "precision"]
    options = {name: values[name] for name in automatic if values[name] != 0}
    options["n_threads"] = values["n_threads"]
    if filter_name == RECONSTRUCT:
        options["use_normals"] = values["use_normals"]
        if CLOSINGS[values["closed"]] != "auto":
            options["closed"] = CLOSINGS[values["closed"]] == "yes"
    orientation = ORIENTATIONS[values["orientation"]]
    if orientation == "viewpoint":
        options["viewpoint"] = [float(x) for x in values["viewpos"]]
    elif orientation == "direction":
        options["towards"] = [float(x) for x in values["direction"]]
    return options


def _expected(name: str, expected: str, value: object) -> pymeshlab.PyMeshLabException:
    return pymeshlab.PyMeshLabException(
        f"Parameter {name}: expected {expected}, got {validation.shown(value)}."
    )


def _bool(name: str, value: Any) -> bool:
    if not isinstance(value, (bool, np.bool_)):
        raise _expected(name, "True or False", value)
    return bool(value)


def _int(name: str, value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise _expected(name, "an integer", value)
    return int(value)


def _level(name: str, value: Any) -> float | str:
    if isinstance(value, str) and value == "auto":
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise _expected(name, 'a number or "auto"', value)
    try:
        return float(value)
    except OverflowError:
        raise _expected(name, 'a number or "auto"', value) from None


def _length(name: str, value: Any, diagonal: float) -> float:
    if isinstance(value, pymeshlab.PercentageValue):
        # MeshLab's own arithmetic, in single precision: both ways to a filter give one number.
        with np.errstate(over="ignore"):
            return float(np.float32(value.value()) / np.float32(100) * np.float32(diagonal))
    if isinstance(value, pymeshlab.PureValue):
        return float(value.value())
    raise _expected(
        name,
        "pymeshlab.PercentageValue(...) of the bounding box diagonal "
        "or pymeshlab.PureValue(...) in the cloud's unit",
        value,
    )


def _enum(name: str, value: Any, choices: tuple[str, ...]) -> int:
    if isinstance(value, str) and value in choices:
        return choices.index(value)
    if isinstance(value, str):
        expected = f"Possible values are {', '.join(map(repr, choices))}"
        raise InvalidEnum(f"Enum {validation.shown(value)} not found. {expected}.")
    number = _int(name, value)
    if not 0 <= number < len(choices):
        expected = f"Must be a value from 0 to {len(choices) - 1}"
        raise InvalidEnum(f"Enum {validation.shown(number)} not valid. {expected}.")
    return number


def _point(name: str, value: Any) -> np.ndarray:
    try:
        point = validation.check_vector(value, name)
    except ValueError:
        point = None
    if point is None:
        raise _expected(name, "three finite numbers", value)
    return point


_CONVERT: dict[str, Callable[[str, Any], Any]] = {
    "bool": _bool,
    "int": _int,
    "level": _level,
    "enum": functools.partial(_enum, choices=ORIENTATIONS),
    "closing": functools.partial(_enum, choices=CLOSINGS),
    "point": _point,
}
