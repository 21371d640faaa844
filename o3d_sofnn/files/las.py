"""LAS, LAZ and COPC through laspy, in double precision.

laspy trusts every number in a header, so these are checked against the file's length first.
lazrs, which unpacks LAZ, may crash or allocate any amount of memory: it runs in a separate process.
"""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.files import child, columns, las_layout, sidecar
from o3d_sofnn.files.columns import Array, PointFile
from o3d_sofnn.files.regular import open_regular, read_records
from o3d_sofnn.files.writers.colors import color_levels

if TYPE_CHECKING:
    from o3d_sofnn.adapters import CloudArrays

FORMATS = frozenset({".las", ".laz"})


_logger = logging.getLogger(__name__)


_NORMALS = ("NormalX", "NormalY", "NormalZ")


_COLORS = ("red", "green", "blue")


_WKT, _GEO_KEYS = 2112, 34735


# GeoTIFF keys of projected and of geographic coordinate systems.
_EPSG_KEYS = (3072, 2048)


def read_las(path: Path) -> PointFile:
    """Return the points of a LAS, LAZ or COPC file with all their dimensions.

    Parameters
    ----------
    path : pathlib.Path
        The file.

    Returns
    -------
    PointFile
        Coordinates in the file's unit; "colors" as levels of 8 or 16 bits; normals from the extra
        dimensions NormalX, NormalY, NormalZ when present; other dimensions under their names.

    Raises
    ------
    OSError
        The file cannot be opened.
    ValueError
        The file is not LAS or LAZ, or cut short.
    ImportError
        laspy is not installed.
    """
    data = _open(path)
    with laspy_errors(path):
        names = [name for name in data.point_format.dimension_names if name not in ("X", "Y", "Z")]
        found = {name: np.asarray(data[name]) for name in ("x", "y", "z", *names)}
        return columns.from_columns(path, found, crs=crs_of(data.header))


def is_las(path: Path) -> bool:
    """Return whether a file begins like LAS and LAZ."""
    try:
        with open_regular(path) as stream:
            return stream.read(4) == b"LASF"
    except (OSError, ValueError):
        return False


def write_las(
    stream: BinaryIO,
    cloud: CloudArrays,
    compress: bool,
    template: Path | None,
    extra: Mapping[str, NDArray[Any]] = MappingProxyType({}),
    crs: str | None = None,
) -> None:
    """Write points and normals (extra dimensions NormalX, NormalY, NormalZ in double).

    Parameters
    ----------
    stream : binary stream
        Where to write; seekable.
    cloud : CloudArrays
        Finite coordinates, and normals.
    compress : bool
        True for LAZ.
    template : pathlib.Path or None
        A LAS or LAZ file with the same points in the same order: everything in it (scale, offset,
        coordinate system, all dimensions) is kept, except the index of COPC. None writes LAS 1.4
        with coordinates rounded to the finest power of ten with which 32 bits cover the extent.
    extra : mapping of str to numpy.ndarray, shape (n, 1)
        Further numbers per point, written as extra dimensions of their type, under unused names.
    crs : str, optional
        Coordinate system; also used for a template without one.

    Raises
    ------
    ValueError
        Coordinates are not finite, or ``template`` has a different number of points.
    ImportError
        laspy is not installed.
    """
    data = _new(cloud) if template is None else _open(template)
    if len(data.points) != len(cloud.points):
        raise ValueError(
            f"pcd: expected the {len(data.points)} points of {template}, got {len(cloud.points)}"
        )
    if crs is not None and crs_of(data.header) is None:
        _add_crs(data.header, crs)
    _write(stream, data, cloud.normals, compress, extra)


def check_las(
    points: Array,
    compress: bool,
    template: Path | None,
    extra: Mapping[str, NDArray[Any]] = MappingProxyType({}),
) -> None:
    """Raise what :func:`write_las` would raise, without the points.

    Parameters
    ----------
    points : numpy.ndarray, shape (n, 3)
        The points to be written.
    compress, template
        As in :func:`write_las`.
    extra : mapping of str to numpy.ndarray, shape (1, 1)
        The same with one row.
    """
    laspy = import_laspy()
    if template is None:
        _check_finite(points)
        return
    with open_regular(template) as stream:
        header = read_header(stream, template)[1]
    with laspy_errors(template, "to be written again, choose an OUT like .ply"):
        one = laspy.LasData(header, laspy.PackedPointRecord.zeros(1, header.point_format))
        _write(io.BytesIO(), one, np.zeros((1, 3)), compress, extra)


def _write(
    stream: BinaryIO,
    data: Any,
    normals: Array | None,
    compress: bool,
    extra: Mapping[str, NDArray[Any]],
) -> None:
    laspy = import_laspy()
    # LAS has no Boolean dimensions.
    types = {name: v.dtype if v.dtype.kind in "iuf" else "u1" for name, v in extra.items()}
    data.add_extra_dims([laspy.ExtraBytesParams(name, kind) for name, kind in types.items()])
    for name, values in extra.items():
        data[name] = values[:, 0]
    if normals is not None:
        kinds = {d.name: d.dtype for d in data.point_format.extra_dimensions}
        # A dimension of integers would round normals to zero.
        data.remove_extra_dims([n for n in _NORMALS if n in kinds and kinds[n].kind != "f"])
        kept = set(data.point_format.dimension_names)
        data.add_extra_dims([laspy.ExtraBytesParams(n, "f8") for n in _NORMALS if n not in kept])
        for name, values in zip(_NORMALS, normals.T, strict=True):
            data[name] = values
    if data.header.version.minor == 0:  # laspy writes from 1.1 on, which differs in names alone
        data.header.version = laspy.header.Version.from_str("1.1")
    # The written points are not in the order of an octree.
    for records in (data.header.vlrs, data.header.evlrs or []):
        records[:] = [record for record in records if record.user_id != "copc"]
    # In memory first: on a full disk the compressor would hide the reason.
    packed = io.BytesIO()
    with laspy.LasWriter(
        packed, data.header, do_compress=compress, closefd=False, encoding_errors="replace"
    ) as writer:
        writer.write_points(data.points)
        if data.header.version.minor >= 4 and data.header.evlrs:
            writer.write_evlrs(data.header.evlrs)
    stream.write(packed.getbuffer())


def _new(cloud: CloudArrays) -> Any:
    laspy = import_laspy()
    _check_finite(cloud.points)
    colors = color_levels(cloud, "u2")
    header = laspy.LasHeader(version="1.4", point_format=6 if colors is None else 7)
    low, high = cloud.points.min(axis=0), cloud.points.max(axis=0)
    header.offsets = np.floor(low)
    steps = 2.0**31 - 1
    header.scales = 10.0 ** np.ceil(np.log10(np.maximum(high - header.offsets, 1e-6) / steps))
    data = laspy.LasData(header)
    data.x, data.y, data.z = cloud.points.T
    if colors is not None:
        data.red, data.green, data.blue = colors.T
    return data


def _check_finite(points: Array) -> None:
    if not np.isfinite(points).all():
        raise ValueError("pcd: expected finite coordinates for LAS, got NaN or inf")


def _open(path: Path) -> Any:
    """Return the file as laspy's LasData; its points may be changed."""
    laspy = import_laspy()
    with open_regular(path) as stream:
        layout, header = read_header(stream, path)
        if header.are_points_compressed:
            raw = bytearray()
            for frame in child.run(las_layout.__name__, path):
                raw += frame
        else:
            stream.seek(layout.offset)
            raw = bytearray(read_records(stream, path, layout.count, layout.record))
    if len(raw) != layout.count * layout.record:
        got = len(raw) // layout.record
        raise ValueError(f"{path}: cut short: {got} of {layout.count} points")
    with laspy_errors(path):
        points = laspy.PackedPointRecord.from_buffer(raw, header.point_format)
        return laspy.LasData(header, points)


def read_header(stream: BinaryIO, path: Path) -> tuple[las_layout.Layout, Any]:
    """Return where the points are, and laspy's header."""
    laspy = import_laspy()
    layout = las_layout.read_layout(stream, path)
    stream.seek(0)
    with laspy_errors(path):
        header = laspy.LasHeader.read_from(stream, read_evlrs=True)
        sound = np.isfinite([*header.scales, *header.offsets]).all() and np.all(header.scales)
        if not sound or header.point_format.size != layout.record:
            raise ValueError("scales, offsets or sizes without sense")
    return layout, header


def crs_of(header: Any) -> str | None:
    """Return the coordinate system as WKT, or as an EPSG number from GeoTIFF keys."""
    records = [*header.vlrs, *(header.evlrs or [])]
    records = [record for record in records if record.user_id == "LASF_Projection"]
    for record in records:
        if record.record_id == _WKT and record.string:
            return str(record.string)
    keys = {
        key.id: key.value_offset for r in records if r.record_id == _GEO_KEYS for key in r.geo_keys
    }
    codes = [keys[key] for key in _EPSG_KEYS if 1024 <= keys.get(key, 0) <= 32766]
    return f"EPSG:{codes[0]}" if codes else None


def _add_crs(header: Any, crs: str) -> None:
    """Add a coordinate system as WKT, which LAS has since version 1.4."""
    text = sidecar.as_wkt(crs)
    if header.version.minor < 4:
        _logger.warning("not kept: the coordinate system; LAS has text for it since version 1.4")
        return
    if text is None:
        _logger.warning("%s", sidecar.not_kept(crs))
        return
    header.vlrs.append(import_laspy().vlrs.known.WktCoordinateSystemVlr(text))
    header.global_encoding.wkt = True


@contextlib.contextmanager
def laspy_errors(path: Path, what: str = "readable as LAS or LAZ") -> Iterator[None]:
    """Convert all exceptions that laspy raises for a header to ``ValueError``."""
    try:
        yield
    except (OSError, MemoryError, ImportError):
        raise
    except Exception as error:
        raise ValueError(f"{path}: not {what}: {error}") from error


def import_laspy() -> Any:
    """Return the module ``laspy``; ``ImportError`` says what to type."""
    try:
        import laspy
    except ModuleNotFoundError as error:
        raise ImportError(
            'LAS and LAZ files need laspy; type: pip install "laspy[lazrs]"'
        ) from error
    # Without a handler, its log messages would go to the screen.
    logger = logging.getLogger("laspy")
    if not logger.handlers:
        logger.addHandler(logging.NullHandler())
    return laspy
