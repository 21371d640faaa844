"""Numbered lines of text, and tables of numbers read from them."""

from __future__ import annotations

import codecs
import io
import itertools
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import BinaryIO, TextIO

import numpy as np

from o3d_sofnn.files.columns import Array
from o3d_sofnn.files.regular import bytes_left, open_regular

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)


# A row that no table takes.
NO_ROW = "?"


# Bytes looked at to tell an encoding.
_HEAD = 4096


# Bytes at the end, and numbers with decimals among them, that show whether the last one is whole.
_TAIL, _ENOUGH_NUMBERS = 8192, 9


# Fewer decimals than this do not indicate a format with a fixed number of decimals.
_FEW_DECIMALS = 3


class Lines:
    """Iterates over lines and remembers the last one and its number, for messages.

    Attributes
    ----------
    text : str
        The line that was returned last.
    number : int
        Number of that line, from 1.
    """

    def __init__(self, stream: TextIO, path: Path, number: int = 0) -> None:
        self._stream = stream
        self._path = path
        self.text = ""
        self.number = number

    def __iter__(self) -> Iterator[str]:
        """Yield the remaining lines."""
        for text in self._stream:
            self.text = text
            self.number += 1
            yield text

    def fault(self, expected: str) -> ValueError:
        """Return an error about the last line."""
        return ValueError(
            f"{self._path}: line {self.number}: expected {expected}, got {excerpt(self.text)}"
        )


def open_text(path: Path) -> TextIO:
    """Open a text in UTF-8, or in UTF-16 or UTF-32 if its first bytes say so.

    Raises
    ------
    OSError, ValueError
        As in :func:`o3d_sofnn.files.regular.open_regular`; also when the contents are no text.
    """
    stream = open_regular(path)
    try:
        encoding = _encoding(stream, path)
    except BaseException:
        stream.close()
        raise
    return as_text(stream, encoding)


def as_text(stream: BinaryIO, encoding: str = "utf-8") -> TextIO:
    """Return the rest of a binary stream as text; undecodable bytes become a mark."""
    return io.TextIOWrapper(stream, encoding=encoding, errors="replace")


def read_table(
    rows: Iterable[str], width: int, lines: Lines, delimiter: str | None = None
) -> Array:
    """Return a table of numbers, one row of ``width`` columns for every text of ``rows``.

    Parameters
    ----------
    rows : iterable of str
        Rows, taken from ``lines`` one by one.
    width : int
        Number of columns.
    lines : Lines
        Source of the rows, for messages.
    delimiter : str, optional
        One character; None is white space.

    Raises
    ------
    ValueError
        A row does not have ``width`` numbers; the message names its line.
    """
    rows = iter(rows)
    first = next(rows, None)
    if first is None:
        return np.zeros((0, width))
    try:
        table = np.loadtxt(
            itertools.chain([first], rows), delimiter=delimiter, comments=None, ndmin=2
        )
    except ValueError as error:
        # NumPy takes rows one at a time: the last one taken is at fault.
        raise lines.fault(f"{width} numbers") from error
    if table.shape[1] != width:
        raise lines.fault(f"{width} numbers a line")
    return table


def check_end(path: Path, decimal_sign: str = ".") -> None:
    """Raise ``ValueError`` if the file ends in the middle of its last number.

    This is the case if its last line is not terminated, and the last number has fewer decimals than
    the others, which all have the same number of decimals.
    """
    tail, is_all = _tail(path)
    *whole, last = tail.splitlines() or [""]
    if not is_all:
        whole = whole[1:]
    if tail.endswith(("\n", "\r")):
        return
    decimals = re.compile(rf"\d\{decimal_sign}(\d+(?:[eE][+-]?\d+)?)")
    lengths = [len(digits) for line in whole for digits in decimals.findall(line)]
    if len(lengths) < _ENOUGH_NUMBERS or len(set(lengths)) > 1 or lengths[0] < _FEW_DECIMALS:
        return
    ends = re.compile(rf"\d\{decimal_sign}?([\deE+-]*)\s*$")
    before, end = ends.search(whole[-1]), ends.search(last)
    if before and len(before[1]) == lengths[0] and (end is None or len(end[1]) < lengths[0]):
        raise ValueError(f"{path}: cut short: the last number ends after {excerpt(last[-20:])}")


def excerpt(text: str) -> str:
    """Return the beginning of a text in quotes, control characters made visible."""
    text = " ".join(text.split())
    return repr(text if len(text) <= 60 else text[:57] + "...")


def _tail(path: Path) -> tuple[str, bool]:
    """Return the end of a text, and whether that is all of it."""
    with open_regular(path) as stream:
        if b"\0" in stream.read(_HEAD):
            with open_text(path) as text:
                return text.read(), True
        stream.seek(0)
        size = bytes_left(stream)
        stream.seek(max(size - _TAIL, 0))
        return stream.read().decode(errors="replace"), size <= _TAIL


def _encoding(stream: BinaryIO, path: Path) -> str:
    head = stream.read(_HEAD)
    stream.seek(0)
    for mark, encoding in _MARKS:
        if head.startswith(mark):
            return encoding
    if b"\0" not in head:
        return "utf-8"
    # In UTF-16, every other byte of digits is zero.
    for encoding, zeros in (("utf-16-le", head[1::2]), ("utf-16-be", head[0::2])):
        if not any(zeros):
            return encoding
    raise ValueError(f"{path}: expected lines of numbers, got binary contents")
