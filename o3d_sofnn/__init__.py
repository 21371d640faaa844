"""Oriented normals and meshes, closed or open, from raw point clouds.

The method is the self-organized fuzzy neural network (SOFNN) of "A Novel Self-Organized Fuzzy
Neural Network Surface Reconstruction Algorithm for Point Clouds Without Normal".

Names are loaded on first use, so that ``import o3d_sofnn`` costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from o3d_sofnn.operators.common import ReconstructionWarning
    from o3d_sofnn.operators.drop_in import create_from_point_cloud_sofnn
    from o3d_sofnn.operators.normals import NormalDetails, estimate_normals
    from o3d_sofnn.operators.online import OnlineReconstruction
    from o3d_sofnn.operators.surfaces import SurfaceDetails, reconstruct_surface
    from o3d_sofnn.operators.tiles import TilesReport, reconstruct_tiles
    from o3d_sofnn.sofnn.estimator import SOFNN
    from o3d_sofnn.sofnn.fuzzy_c_means import fuzzy_c_means

    __version__: str

__all__ = [
    "SOFNN",
    "NormalDetails",
    "OnlineReconstruction",
    "ReconstructionWarning",
    "SurfaceDetails",
    "TilesReport",
    "__version__",
    "create_from_point_cloud_sofnn",
    "estimate_normals",
    "fuzzy_c_means",
    "reconstruct_surface",
    "reconstruct_tiles",
]

_HOME = {
    "SOFNN": "o3d_sofnn.sofnn.estimator",
    "NormalDetails": "o3d_sofnn.operators.normals",
    "OnlineReconstruction": "o3d_sofnn.operators.online",
    "ReconstructionWarning": "o3d_sofnn.operators.common",
    "SurfaceDetails": "o3d_sofnn.operators.surfaces",
    "TilesReport": "o3d_sofnn.operators.tiles",
    "create_from_point_cloud_sofnn": "o3d_sofnn.operators.drop_in",
    "estimate_normals": "o3d_sofnn.operators.normals",
    "fuzzy_c_means": "o3d_sofnn.sofnn.fuzzy_c_means",
    "reconstruct_surface": "o3d_sofnn.operators.surfaces",
    "reconstruct_tiles": "o3d_sofnn.operators.tiles",
}


def __getattr__(name: str) -> Any:
    value: Any
    if name == "__version__":
        from importlib.metadata import version

        value = version("o3d_sofnn")
    elif name in _HOME:
        value = getattr(importlib.import_module(_HOME[name]), name)
    else:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
