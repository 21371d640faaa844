"""Checks of arrays: a ``ValueError`` names the argument, what was expected, and what was given."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from o3d_sofnn.validation.values import real_array, shown

MIN_POINTS = 4
# Sixth powers of lengths, as in the normal equations of a quadric, stay representable.
_LARGEST = 1e50


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
        The shape is wrong, values are not finite real numbers, or there are fewer than 4 points.
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
        The shape is wrong, or values are not real numbers.
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
    """Raise ``ValueError`` for finite points whose volumes double precision cannot represent.

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
        The value is not three finite real numbers.
    """
    if value is None:
        return None
    vector = real_array(value, name, "three numbers")
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
        The value is neither three finite numbers nor three for each point.
    """
    if value is None:
        return None
    places = real_array(value, name, "three numbers")
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
        The value is not three finite real numbers, or all of them are zero.
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
