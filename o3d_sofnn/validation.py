"""Checks of arrays and options: a ``ValueError`` that names the argument, expected and got."""

from __future__ import annotations

import operator
import os
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

MIN_POINTS = 4
# A local quadric has six coefficients.
MIN_NEIGHBORS = 6
# Deeper octrees than this need more cells than 32-bit indices can name.
MAX_DEPTH = 16
# Sixth powers of lengths, as in the normal equations of a quadric, stay representable.
_LARGEST = 1e50
# Native code counts with 32 bits.
LARGEST = 2**31 - 1
_MOST_THREADS = 256
# Letters of a value in a message.
_LINE = 80


def check_points(points: ArrayLike, name: str = "points") -> NDArray[np.float64]:
    """Return ``points`` as a finite, C-contiguous ``(n, 3)`` float64 array, n >= 4.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Coordinates in any unit.
    name : str, default "points"
        The argument's name, for the message.

    Returns
    -------
    numpy.ndarray, shape (n, 3)
        A view where the input already fits, else a copy.

    Raises
    ------
    ValueError
        Wrong shape, values that are not real numbers, NaN or infinity, fewer than 4 points.
    """
    array = check_array(points, name)
    finite = finite_rows(array)
    if not finite.all():
        bad = int(len(array) - np.count_nonzero(finite))
        raise ValueError(f"{name}: expected finite coordinates, got {bad} rows with NaN or inf")
    check_point_count(len(array), name)
    return array


def check_array(values: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return ``values`` as a C-contiguous ``(n, 3)`` float64 array; NaN and infinity may stay.

    Parameters
    ----------
    values : array_like, shape (n, 3)
        Real numbers.
    name : str
        The argument's name, for the message.

    Returns
    -------
    numpy.ndarray, shape (n, 3)
        A view where the input already fits, else a copy.

    Raises
    ------
    ValueError
        Wrong shape, or values that are not real numbers.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name}: expected real numbers, got dtype {array.dtype}")
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name}: expected shape (n, 3), got {array.shape}")
    return np.ascontiguousarray(array, dtype=np.float64)


def check_point_count(count: int, name: str) -> None:
    """Raise ``ValueError`` unless ``count`` points are enough for a surface (4)."""
    if count < MIN_POINTS:
        raise ValueError(f"{name}: expected at least {MIN_POINTS} finite points, got {count}")


def finite_rows(array: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return an ``(n,)`` mask of the rows without NaN and infinity."""
    return np.asarray(np.isfinite(array).all(axis=1))


def check_magnitude(points: NDArray[np.float64], name: str) -> None:
    """Raise ``ValueError`` for finite points whose volumes double precision cannot hold.

    Parameters
    ----------
    points : numpy.ndarray, shape (n, 3)
        Finite coordinates.
    name : str
        The argument's name, for the message.
    """
    largest = float(np.abs(points).max(initial=0.0))
    extent = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    if largest > _LARGEST or 0.0 < extent < 1.0 / _LARGEST:
        raise ValueError(
            f"{name}: expected coordinates below {_LARGEST:g} and an extent above "
            f"{1.0 / _LARGEST:g}, got {largest:g} and {extent:g}"
        )


def check_vector(value: ArrayLike | None, name: str) -> NDArray[np.float64] | None:
    """Return ``value`` as a finite ``(3,)`` float64 array, or None.

    Raises
    ------
    ValueError
        Not three finite real numbers.
    """
    if value is None:
        return None
    vector = _real_array(value, name, "three numbers")
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{name}: expected three finite numbers, got {shown(value)}")
    return vector


def check_viewpoint(
    value: ArrayLike | None, n_points: int, name: str
) -> NDArray[np.float64] | None:
    """Return ``value`` as a finite ``(3,)`` or ``(n_points, 3)`` float64 array, or None.

    Raises
    ------
    ValueError
        Neither three finite numbers nor three for each point.
    """
    if value is None:
        return None
    places = _real_array(value, name, "three numbers")
    if places.ndim != 2:
        check_vector(value, name)
    elif places.shape != (n_points, 3):
        raise ValueError(f"{name}: expected shape (3,) or ({n_points}, 3), got {places.shape}")
    elif not np.isfinite(places).all():
        bad = int((~finite_rows(places)).sum())
        raise ValueError(f"{name}: expected finite numbers, got {bad} rows with NaN or inf")
    if np.abs(places).max(initial=0.0) > _LARGEST:
        raise ValueError(f"{name}: expected coordinates below {_LARGEST:g}, got {shown(value)}")
    return places


def check_direction(value: ArrayLike | None, name: str) -> NDArray[np.float64] | None:
    """Return ``value`` as a unit ``(3,)`` vector, or None.

    Raises
    ------
    ValueError
        Not three finite real numbers, or all of them zero.
    """
    vector = check_vector(value, name)
    if vector is None:
        return None
    # Dividing by the largest entry first keeps very long and very short vectors representable.
    largest = np.abs(vector).max()
    if largest == 0:
        raise ValueError(f"{name}: expected a direction other than zero, got {shown(value)}")
    vector = vector / largest
    unit: NDArray[np.float64] = vector / np.linalg.norm(vector)
    return unit


def check_integer(value: Any, name: str, minimum: int, maximum: int = LARGEST) -> int | None:
    """Return ``value`` as an int within [minimum, maximum], or None.

    Raises
    ------
    ValueError
        Not an integer, or out of range.
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
        Not a real number, not finite, zero or negative.
    """
    number = _real(value, name, "a number above 0")
    if number is not None and not 0 < number < np.inf:
        raise ValueError(f"{name}: expected a finite number above 0, got {shown(value)}")
    return number


def check_trim(value: Any) -> float | Literal["auto"] | None:
    """Return ``trim``: a float within [0, 1], "auto", or None.

    Raises
    ------
    ValueError
        Anything else.
    """
    if isinstance(value, str) and value == "auto":
        return "auto"
    expected = 'a number from 0 to 1 or "auto"'
    number = _real(value, "trim", expected)
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
    if isinstance(value, str) and value == "auto":
        return "auto"
    raise ValueError(f'closed: expected True, False or "auto", got {value!r}')


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
    """Return ``value`` as a bool; numbers that are not 0 or 1, texts and arrays are no flags.

    Raises
    ------
    ValueError
        Neither True nor False.
    """
    if isinstance(value, (bool, int, np.bool_, np.integer)) and value in (0, 1):
        return bool(value)
    raise ValueError(f"{name}: expected {expected}, got {shown(value)}")


def check_exclusive(**options: Any) -> None:
    """Raise ``ValueError`` when more than one of ``options`` is given (is not None)."""
    given = [name for name, value in options.items() if value is not None]
    if len(given) > 1:
        raise ValueError(f"{' and '.join(given)}: expected at most one of them, got both")


def shown(value: Any) -> str:
    """Return what a message says of a value: one line, not too long, whatever the value is."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # an integer with too many digits, or a class whose text fails
        return f"a value of type {type(value).__name__}"
    return text if len(text) <= _LINE else f"{text[: _LINE - 3]}..."


def _real(value: Any, name: str, expected: str) -> float | None:
    if value is None:
        return None
    number = _real_array(value, name, expected)
    if number.ndim or isinstance(value, (bool, np.bool_)):
        raise ValueError(f"{name}: expected {expected}, got {shown(value)}")
    return float(number)


def _real_array(value: Any, name: str, expected: str) -> NDArray[np.float64]:
    """Return a new array: a caller's may change during the call. Too large is infinite."""
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


def thread_count(n_threads: int) -> int:
    """Return how many threads to start: more than there are cores only cost memory."""
    if n_threads > 0:
        return min(n_threads, _MOST_THREADS)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
