"""How the lines of a delimited text are split, found out from those before the second row."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from o3d_sofnn.files.readers.lines import Lines, excerpt

COMMENTS = ("#", "//", "%")


_NUMBER = re.compile(
    r"[+-]?(?:(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?|nan|inf|infinity)", re.IGNORECASE | re.ASCII
)


# Delimiters, None for white space, and whether a comma is the decimal sign, in the order of trial:
# a decimal comma is the last explanation of a comma.
_SPLITS = (
    *((delimiter, False) for delimiter in ("\t", None, ";", ",", "|")),
    *((delimiter, True) for delimiter in ("\t", None, ";", "|")),
)


# With decimal commas, a point is part of no number.
_SWAPPED = str.maketrans(",.", ".,")


# Lines of plain words before the first row, such as a title and names of columns.
_MOST_TITLES = 10


class Split(NamedTuple):
    """A way to take a line apart.

    Attributes
    ----------
    delimiter : str or None
        One character; None is white space.
    decimal_comma : bool
        Whether 1,5 is one and a half.
    trailing : bool
        Whether lines end with a delimiter that no value follows.
    """

    delimiter: str | None
    decimal_comma: bool
    trailing: bool = False

    def with_points(self, text: str) -> str:
        """Return a line with decimal points."""
        return text.translate(_SWAPPED) if self.decimal_comma else text

    def fields(self, text: str) -> list[str]:
        """Return the fields of a line with decimal points and without quotes."""
        text = self.with_points(text)
        if self.trailing:
            text = text.removesuffix(self.delimiter or "")
        return [field.strip().strip('"') for field in text.split(self.delimiter)]


@dataclass(frozen=True)
class Layout:
    """What the first lines say.

    Attributes
    ----------
    split : Split
        How lines are taken apart.
    width : int
        Number of fields in a line.
    used : tuple of int
        The fields that are numbers.
    names : tuple of str, or None
        Names of the columns that are used.
    skip : int
        Lines before the first row.
    announced : int or None
        The number of rows, where a line before them says it.
    notes : tuple of str
        What is not used.
    """

    split: Split
    width: int
    used: tuple[int, ...]
    names: tuple[str, ...] | None
    skip: int
    announced: int | None
    notes: tuple[str, ...]


def without_comment(line: str) -> str:
    """Return a line without white space around it, empty if it is a comment."""
    text = line.strip()
    return "" if text.startswith(COMMENTS) else text


def find(lines: Lines) -> Layout | None:
    """Return the layout of a text, or None if there is nothing but comments.

    Raises
    ------
    ValueError
        A line is neither a row of numbers nor plain words in front of them.
    """
    titles: list[tuple[int, str]] = []
    comments: list[str] = []
    announced = None
    for line in lines:
        text = without_comment(line)
        if not text:
            comments.append(line.strip())
            continue
        split = _best_split(text)
        if split is not None:
            return _finish(lines, split, titles, comments, announced)
        if text.isdecimal() and text.isascii() and announced is None:
            announced = int(text[:18])
        elif any(map(_is_number, re.split(r"[\s,;|]+", text))) or len(titles) == _MOST_TITLES:
            raise lines.fault("at least three numbers")
        else:
            titles.append((lines.number, text))
    if titles:
        raise lines.fault("lines of at least three numbers")
    return None


def _finish(
    lines: Lines,
    split: Split,
    titles: list[tuple[int, str]],
    comments: list[str],
    announced: int | None,
) -> Layout:
    text, skip = lines.text.strip(), lines.number - 1
    fields = split.fields(text)
    used = tuple(i for i, field in enumerate(fields) if _is_number(field))
    notes = []
    if len(used) < len(fields):
        _check_words(lines, split, len(fields), used)
        left_out = [str(i + 1) for i in range(len(fields)) if i not in used]
        notes.append(f"columns left out, which are no numbers: {' '.join(left_out)}")
    names, unused = _names(titles, comments, split, len(fields))
    notes += [f"line {number} left out: {excerpt(text)}" for number, text in unused]
    kept = None if names is None else tuple(names[i] for i in used)
    return Layout(split, len(fields), used, kept, skip, announced, tuple(notes))


def _best_split(text: str) -> Split | None:
    """Return the first split into numbers alone, else that with most of them, at least three."""
    best, most = None, 2
    for delimiter, decimal_comma in _SPLITS:
        trailing = delimiter is not None and text.endswith(delimiter)
        split = Split(delimiter, decimal_comma, trailing)
        fields = split.fields(text)
        count = sum(map(_is_number, fields))
        if count == len(fields) >= 3:
            return split
        if count > most:
            best, most = split, count
    return best


def _check_words(lines: Lines, split: Split, width: int, used: tuple[int, ...]) -> None:
    """Raise ``ValueError`` if words of the first row are numbers in the second: it is damaged."""
    fault = lines.fault(f"{width} numbers")
    following = next((text for text in map(without_comment, lines) if text), None)
    if following is None:
        return
    fields = split.fields(following)
    if len(fields) == width and any(
        _is_number(field) for i, field in enumerate(fields) if i not in used
    ):
        raise fault


def _names(
    titles: list[tuple[int, str]], comments: Sequence[str], split: Split, width: int
) -> tuple[list[str] | None, list[tuple[int, str]]]:
    """Return the names of the columns, and the lines before the rows that are not them."""
    if titles:
        names = _fields_of_names(titles[-1][1], split, width)
        # Words between blanks may be a sentence.
        if names is not None and (split.delimiter is not None or _name_coordinates(names)):
            return names, titles[:-1]
    for comment in reversed(comments):
        names = _fields_of_names(comment.lstrip("#/% "), split, width)
        if names is not None and _name_coordinates(names):
            return names, titles
    return None, titles


def _fields_of_names(text: str, split: Split, width: int) -> list[str] | None:
    """Return ``width`` names; programs delimit them like the numbers, or by blanks or commas."""
    for way in (split, Split(None, False), Split(",", False)):
        names = way.fields(text)
        if len(names) == width and all(names):
            return names
    return None


def _name_coordinates(names: list[str]) -> bool:
    return {"x", "y", "z"} <= {name.lower() for name in names}


def _is_number(field: str) -> bool:
    return _NUMBER.fullmatch(field) is not None
