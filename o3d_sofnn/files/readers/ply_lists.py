"""PLY elements whose rows have lists, such as the corners of faces."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.files.columns import Array
from o3d_sofnn.files.readers.lines import Lines
from o3d_sofnn.files.regular import bytes_left

Columns = dict[str, NDArray[Any]]


@dataclass
class Element:
    """A kind of thing in the file.

    Attributes
    ----------
    name : str
    count : int
        Rows, as the header says.
    properties : list of (name, type, type of a list's count or None)
    """

    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)

    @property
    def has_lists(self) -> bool:
        """Whether rows have different lengths."""
        return any(counter for _, _, counter in self.properties)


@dataclass
class List:
    """A list property.

    Attributes
    ----------
    counts : numpy.ndarray, shape (rows,)
    values : numpy.ndarray, shape (sum of counts,)
    """

    counts: NDArray[Any]
    values: NDArray[Any]


def read_lists(
    stream: BinaryIO, element: Element, order: str, path: Path
) -> tuple[Columns, dict[str, List]]:
    """Read rows of different length, quickly where the lists are all as long as the first."""
    smallest = sum(int((counter or kind)[1]) for _, kind, counter in element.properties)
    if element.count * smallest > bytes_left(stream):
        raise cut_short(path, element)
    start = stream.tell()
    data = memoryview(stream.read())
    rows = _Rows(data, element, order)
    alike = rows.alike() if element.count else None
    if alike is not None:
        stream.seek(start + alike.nbytes)
        return rows.split(alike)
    try:
        result, end = rows.walk()
    except (ValueError, IndexError):
        raise cut_short(path, element) from None
    stream.seek(start + end)
    return result


class _Rows:
    """The rows of an element with lists."""

    def __init__(self, data: memoryview, element: Element, order: str) -> None:
        self._data = data
        self._count = element.count
        self._properties = [
            (name, np.dtype(order + kind), None if counter is None else np.dtype(order + counter))
            for name, kind, counter in element.properties
        ]

    def alike(self) -> NDArray[Any] | None:
        """Return the rows as records if the lists of all are as long as those of the first."""
        fields: list[tuple[Any, ...]] = []
        at = 0
        for name, kind, counter in self._properties:
            if counter is None:
                fields.append((f"value {name}", kind))
                at += kind.itemsize
                continue
            if at + counter.itemsize > len(self._data):
                return None
            length = int(np.frombuffer(self._data, counter, 1, at)[0])
            at += counter.itemsize + length * kind.itemsize
            if length < 0 or at * self._count > len(self._data):
                return None
            fields += [(f"count {name}", counter), (f"list {name}", kind, (length,))]
        if at * self._count > len(self._data):
            return None
        records = np.frombuffer(self._data, np.dtype(fields), self._count)
        counts = [records[name] for name, *_ in fields if name.startswith("count ")]
        return records if all((count == count[0]).all() for count in counts) else None

    def split(self, records: NDArray[Any]) -> tuple[Columns, dict[str, List]]:
        """Return the columns of such records."""
        single, several = {}, {}
        for name, _, counter in self._properties:
            if counter is None:
                single[name] = records[f"value {name}"]
            else:
                several[name] = List(records[f"count {name}"], records[f"list {name}"].reshape(-1))
        return single, several

    def walk(self) -> tuple[tuple[Columns, dict[str, List]], int]:
        """Return the columns, row by row, and the number of bytes that they take."""
        found: dict[str, list[NDArray[Any]]] = {name: [] for name, _, _ in self._properties}
        at = 0
        for _ in range(self._count):
            for name, kind, counter in self._properties:
                length = 1
                if counter is not None:
                    length = int(np.frombuffer(self._data, counter, 1, at)[0])
                    at += counter.itemsize
                if length < 0 or at + length * kind.itemsize > len(self._data):
                    raise ValueError
                found[name].append(np.frombuffer(self._data, kind, length, at))
                at += length * kind.itemsize
        single, several = {}, {}
        for name, kind, counter in self._properties:
            flat = np.concatenate(found[name]) if found[name] else np.zeros(0, kind)
            if counter is None:
                single[name] = flat
            else:
                several[name] = List(np.array([len(row) for row in found[name]], int), flat)
        return (single, several), at


def read_ascii_lists(
    rows: Iterator[str], lines: Lines, element: Element, path: Path
) -> tuple[Columns, dict[str, List]]:
    """Read rows of words."""
    lengths: dict[str, list[int]] = {name: [] for name, _, _ in element.properties}
    found: dict[str, list[float]] = {name: [] for name, _, _ in element.properties}
    read = 0
    for row in rows:
        read += 1
        try:
            words = iter(row.split())
            for name, _, counter in element.properties:
                length = int(next(words)) if counter else 1
                lengths[name].append(length)
                before = len(found[name])
                found[name] += map(float, itertools.islice(words, length))
                if len(found[name]) < before + length or "_" in row:
                    raise ValueError
        except (ValueError, StopIteration):
            raise lines.fault(f"a {element.name}") from None
    if read < element.count:
        raise cut_short(path, element, read)
    single, several = {}, {}
    for name, kind, counter in element.properties:
        flat = typed(np.array(found[name]), kind, f"{path}: property {name}")
        if counter is None:
            single[name] = flat
        else:
            several[name] = List(np.array(lengths[name], dtype=np.int64), flat)
    return single, several


def typed(values: Array, kind: str, name: str) -> NDArray[Any]:
    """Return values in the type that the header says; floating-point ones stay double."""
    if kind[0] == "f":
        return values
    limits = np.iinfo(kind)
    if not ((values == np.rint(values)) & (values >= limits.min) & (values <= limits.max)).all():
        raise ValueError(f"{name}: expected whole numbers from {limits.min} to {limits.max}")
    return values.astype(kind)


def cut_short(path: Path, element: Element, got: int | None = None) -> ValueError:
    """Return an error about rows that are not there."""
    behind = "" if got is None else f", got {got}"
    return ValueError(f"{path}: cut short: expected {element.count} x {element.name}{behind}")
