"""Values of every kind for options, arguments and parameters; most of them are wrong."""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np


class Hostile:
    """Whatever is asked of it fails."""

    def __repr__(self) -> str:
        """Fail."""
        raise RuntimeError("no text")

    def __float__(self) -> float:
        """Fail in another way."""
        raise ZeroDivisionError

    __index__ = __array__ = __bool__ = __len__ = __iter__ = __float__  # type: ignore[assignment]


ODD: tuple[Any, ...] = (
    *(None, True, False, 0, 1, -1, 2, 3, 7, 16, 17, 2**31 - 1, 2**31, 2**63, 10**400, -(10**5000)),
    *(0.0, -0.0, 1.0, 0.5, -0.5, 1e-300, 5e-324, 1e300, float("inf"), float("-inf"), float("nan")),
    *(1j, "", "auto", "1", "up", b"1", (), [], {}, set(), object(), print, Hostile(), [Hostile()]),
    *((0, 0, 1), (0, 0, 0), (1e300, 1e-300, 0), (10**400, 0, 0), (1, 2), "123", range(3)),
    *(np.float32(0.1), np.int8(5), np.uint64(2**63), np.bool_(True), np.longdouble("1e4000")),
    *(np.zeros(3), np.ones((4, 3)), np.ones((2, 2, 3)), np.array(1), np.array([1j, 0, 0])),
    *(
        np.array(["a"]),
        np.datetime64("2020-01-01"),
        Decimal("0.1"),
        Decimal("sNaN"),
        Fraction(1, 3),
    ),
    *(
        Fraction(1, 3),
        np.array([None, 1, 2], dtype=object),
        np.full((60, 3), np.nan),
        [[1, 2, 3], [4, 5]],
    ),
)
"""Values of every kind, for any option."""
GOOD: dict[str, tuple[Any, ...]] = {
    "viewpoint": ((0.0, 0.0, 9.0), np.full((60, 3), 9.0)),
    "towards": ((0.0, 0.0, 1.0),),
    "n_threads": (-1, 1, 2, 7),
    "depth": (3, 5),
    "voxel_size": (0.2, 1.0),
    "use_normals": (True, False),
    "closed": (True, False, "auto"),
    "trim": (0.1, 0.5, "auto"),
    "target_triangles": (4, 50),
    "precision": (0.01,),
    "print_progress": (False, lambda fraction, text: None),
    "return_details": (True,),
    "search_param": (None,),
    "fast_normal_computation": (True, False),
    "max_nn": (6, 40),
    "radius": (0.5,),
}
"""Options of the operators, and values that are meant to work."""
WORDS = (
    *("", "-", "--", "0", "1", "-1", "-1e5", "-.5", "1e999", "nan", "-inf", "auto", "9" * 5000),
    *("7", "0.5", "none", "plain", "bar", "x\ny", "\x1b[31m", "点", "\udcff", "--depth", "-h", "."),
    *("xyz", "las", "obj", "1,2,3", "*", "{stem}.ply"),
)
"""Arguments of a command line."""
FLAGS = (
    *("--max-nn", "--radius", "--threads", "--progress", "--json", "--viewpoint", "--towards"),
    *("--depth", "--voxel-size", "--trim", "--target-triangles", "--precision", "--use-normals"),
    *("--closed", "--no-viewpoint", "--attributes", "--offset"),
    *("--input-format", "--output-format"),
    *("--methods", "--out", "--points", "--noise", "--sizes", "--timeout", "--quick", "--up"),
    *("--clouds", "--nonsense"),
)
"""Options of a command line."""
KINDS: dict[str, tuple[Any, ...]] = {
    "bool": (False, True),
    "int": (0, 2, 7),
    "float": (0.0, 0.5),
    "enum": (0, 1, 2, "automatic", "viewpoint", "direction"),
    "closing": (0, 1, 2, "auto", "yes", "no"),
    "point": ((0.0, 0.0, 9.0),),
}
"""Kinds of the parameters of MeshLab's filters, and values that are meant to work."""


def sphere(rng: np.random.Generator, count: int = 60) -> np.ndarray:
    """Return points (count, 3) of the unit sphere."""
    points = rng.normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def pick(rng: np.random.Generator, values: Any) -> Any:
    """Return one of the values."""
    return values[rng.integers(len(values))]
