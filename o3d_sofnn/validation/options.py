"""Checks of options: a ``ValueError`` names the option, what was expected, and what was given."""

from __future__ import annotations

import operator
from typing import Any, Literal, TypeGuard

import numpy as np

from o3d_sofnn.validation.values import real, shown

# A local quadric has six coefficients.
MIN_NEIGHBORS = 6
# Deeper octrees need more cells than 32-bit indices can address.
MAX_DEPTH = 16
# Native code counts with 32 bits.
LARGEST = 2**31 - 1


def check_integer(value: Any, name: str, minimum: int, maximum: int = LARGEST) -> int | None:
    """Return ``value`` as an int within [minimum, maximum], or None.

    Raises
    ------
    ValueError
        The value is not an integer, or out of range.
    """
    if value is None:
        return None
    expected = f"an integer from {minimum} to {maximum}"
    try:
        number = operator.index(value)
    except Exception:
        raise ValueError(f"{name}: expected {expected}, got {shown(value)}") from None
    if isinstance(value, bool) or not minimum <= number <= maximum:
        raise ValueError(f"{name}: expected {expected}, got {shown(value)}")
    return number


def check_positive(value: Any, name: str) -> float | None:
    """Return ``value`` as a finite float above zero, or None.

    Raises
    ------
    ValueError
        The value is not a finite real number above zero.
    """
    number = real(value, name, "a number above 0")
    if number is not None and not 0 < number < np.inf:
        raise ValueError(f"{name}: expected a finite number above 0, got {shown(value)}")
    return number


def is_auto(value: Any) -> TypeGuard[Literal["auto"]]:
    """Tell whether a value is the word "auto"; comparing an array with it would give an array."""
    return isinstance(value, str) and value == "auto"


def check_trim(value: Any) -> float | Literal["auto"] | None:
    """Return ``trim``: a float within [0, 1], "auto", or None.

    Raises
    ------
    ValueError
        Anything else.
    """
    if is_auto(value):
        return "auto"
    expected = 'a number from 0 to 1 or "auto"'
    number = real(value, "trim", expected)
    if number is not None and not 0 <= number <= 1:
        raise ValueError(f"trim: expected {expected}, got {shown(value)}")
    return number


def check_closed(value: Any) -> bool | Literal["auto"]:
    """Return ``closed``: True, False, or "auto".

    Raises
    ------
    ValueError
        Anything else.
    """
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if is_auto(value):
        return "auto"
    raise ValueError(f'closed: expected True, False or "auto", got {shown(value)}')


def check_n_threads(value: Any) -> int:
    """Return ``n_threads``: -1 (all cores) or a positive integer.

    Raises
    ------
    ValueError
        Anything else.
    """
    number = check_integer(value, "n_threads", -1)
    if number is None or number == 0:
        raise ValueError(f"n_threads: expected -1 (all cores) or at least 1, got {shown(value)}")
    return number


def check_flag(value: Any, name: str, expected: str = "True or False") -> bool:
    """Return ``value`` as a bool; 0 and 1 are accepted, other numbers, texts and arrays are not.

    Raises
    ------
    ValueError
        The value is neither True nor False.
    """
    if isinstance(value, (bool, int, np.bool_, np.integer)) and value in (0, 1):
        return bool(value)
    raise ValueError(f"{name}: expected {expected}, got {shown(value)}")


def check_exclusive(**options: Any) -> None:
    """Raise ``ValueError`` when more than one of ``options`` is given (is not None)."""
    given = [name for name, value in options.items() if value is not None]
    if len(given) > 1:
        raise ValueError(f"{' and '.join(given)}: expected at most one of them, got both")
