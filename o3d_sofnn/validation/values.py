"""Conversion of values of any kind to numbers, and to text in messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# Largest number of characters of a value in a message.
_LINE = 80


def shown(value: Any) -> str:
    """Return a value as text for a message: one short line, whatever the value is."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # an integer with too many digits, or a class whose text fails
        return f"a value of type {type(value).__name__}"
    return text if len(text) <= _LINE else f"{text[: _LINE - 3]}..."


def real(value: Any, name: str, expected: str) -> float | None:
    """Return a number as a float, or None; a ``ValueError`` for anything else."""
    if value is None:
        return None
    number = real_array(value, name, expected)
    if number.ndim or isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name}: expected {expected}, got {shown(value)}")
    return float(number)


def real_array(value: Any, name: str, expected: str) -> NDArray[np.float64]:
    """Return a new array, since the caller's may change; numbers too large become infinite."""
    try:
        array = np.asarray(value)
        # Integers of any length and fractions are objects.
        if array.dtype.kind not in "fiubO":
            raise TypeError
        with np.errstate(over="ignore"):
            return np.array(array, dtype=np.float64, order="C")
    except OverflowError:
        return np.full(np.shape(array), np.inf)
    except Exception:  # a class may raise anything
        raise ValueError(f"{name}: expected {expected}, got {shown(value)}") from None
