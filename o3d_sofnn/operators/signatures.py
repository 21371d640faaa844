"""Types of the operators' arguments, for type checkers only."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, Protocol, TypeAlias, TypedDict, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from o3d_sofnn.progress import ProgressCallback

Array: TypeAlias = NDArray[np.float64]
Points: TypeAlias = NDArray[Any] | Sequence[Sequence[float]]


class _HasPoints(Protocol):
    """A legacy cloud of Open3D, or a PolyData."""

    @property
    def points(self) -> Any: ...


class _HasPoint(Protocol):
    """A tensor cloud of Open3D."""

    @property
    def point(self) -> Any: ...


class _HasVertices(Protocol):
    """A cloud of trimesh."""

    @property
    def vertices(self) -> Any: ...


Cloud = TypeVar("Cloud", bound="_HasPoints | _HasPoint | _HasVertices")


class NormalOptions(TypedDict, total=False):
    """Options of ``estimate_normals``."""

    fast_normal_computation: bool
    max_nn: int | None
    radius: float | None
    viewpoint: ArrayLike | None
    towards: ArrayLike | None
    n_threads: int
    print_progress: bool | ProgressCallback


class SurfaceOptions(TypedDict, total=False):
    """Options of ``reconstruct_surface``."""

    depth: int | None
    voxel_size: float | None
    use_normals: bool
    viewpoint: ArrayLike | None
    towards: ArrayLike | None
    closed: bool | Literal["auto"]
    trim: float | Literal["auto"] | None
    target_triangles: int | None
    precision: float | None
    search_param: Any
    max_nn: int | None
    radius: float | None
    n_threads: int
    print_progress: bool | ProgressCallback
