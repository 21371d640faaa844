"""Results: figures for the report, and values per point for the output."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from o3d_sofnn import validation
from o3d_sofnn.files.columns import PointFile
from o3d_sofnn.meshing.attributes import carry
from o3d_sofnn.results import NormalEstimate, SurfaceEstimate

ATTRIBUTES = ("confidence", "noise", "outlier")
"""Names of the values per point; vertices of a mesh have no value for outlier."""


def attributes(details: NormalEstimate | SurfaceEstimate) -> dict[str, NDArray[Any]]:
    """Return the estimated values of each point, or of each vertex of a mesh.

    Parameters
    ----------
    details : NormalEstimate or SurfaceEstimate
        Result for n points, or with m vertices, which get the noise of the points around them.

    Returns
    -------
    dict of str to numpy.ndarray, shape (n,) or (m,)
        Under some of the names ``ATTRIBUTES``.
    """
    if isinstance(details, SurfaceEstimate):
        noise = carry(details, {"noise": details.normals.noise})
        return {"confidence": details.confidence, **noise}
    values = (details.confidence, details.noise, details.outliers.astype("u1"))
    return dict(zip(ATTRIBUTES, values, strict=True))


def figures(source: PointFile, details: NormalEstimate | SurfaceEstimate) -> dict[str, Any]:
    """Return the report's figures on the points, and on the mesh if there is one."""
    normals = details.normals if isinstance(details, SurfaceEstimate) else details
    # In the details a point without finite coordinates counts as an outlier too.
    not_finite = int((~validation.finite_rows(source.points)).sum())
    figures = {
        "points": len(normals.normals),
        "not_finite": not_finite,
        "outliers": int(normals.outliers.sum()) - not_finite,
        "rules": len(normals.rules),
        "noise_level": normals.noise_level,
        "spacing": normals.spacing,
        "sides": {
            "kind": normals.evidence.kind,
            "text": normals.evidence.text,
            **normals.evidence.figures,
        },
        "warnings": [*source.notes, *details.warnings],
    }
    if isinstance(details, SurfaceEstimate):
        figures |= {
            "vertices": len(details.vertices),
            "triangles": len(details.triangles),
            "watertight": details.watertight,
            "closing": None if details.closing is None else vars(details.closing),
            "quality": vars(details.quality),
        }
    return figures
