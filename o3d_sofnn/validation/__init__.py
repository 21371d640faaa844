"""Checks of what users give: arrays, and options."""

from o3d_sofnn.validation.arrays import (
    MIN_POINTS,
    check_array,
    check_direction,
    check_magnitude,
    check_point_count,
    check_points,
    check_vector,
    check_viewpoint,
    finite_rows,
)
from o3d_sofnn.validation.options import (
    LARGEST,
    MAX_DEPTH,
    MIN_NEIGHBORS,
    check_closed,
    check_exclusive,
    check_flag,
    check_integer,
    check_n_threads,
    check_positive,
    check_trim,
    is_auto,
)
from o3d_sofnn.validation.values import shown

__all__ = [
    "LARGEST",
    "MAX_DEPTH",
    "MIN_NEIGHBORS",
    "MIN_POINTS",
    "check_array",
    "check_closed",
    "check_direction",
    "check_exclusive",
    "check_flag",
    "check_integer",
    "check_magnitude",
    "check_n_threads",
    "check_point_count",
    "check_points",
    "check_positive",
    "check_trim",
    "check_vector",
    "check_viewpoint",
    "finite_rows",
    "is_auto",
    "shown",
]
