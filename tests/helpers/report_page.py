"""The report as a reader without a browser sees it: tables, points of charts, data of panes."""

from __future__ import annotations

import csv
import html.parser
import json
from collections import Counter
from pathlib import Path
from typing import Any


class Page(html.parser.HTMLParser):
    """Tables (titles, values, texts), chart points, and the JSON of the panes.

    Attributes
    ----------
    titles : dict of str to list of str
        Keys of the columns of each table.
    rows : dict of str to list of list of (value, text)
        Cells; the value of a failure is None.
    points : dict of str to list of dict
        data-method, data-x and data-y of each chart.
    data : dict
        Scenes.
    tags : Counter of str
        How many elements of each kind there are.
    attributes : set of str
        Names of all attributes.
    """

    def __init__(self, file: Path) -> None:
        super().__init__()
        self.titles: dict[str, list[str]] = {}
        self.rows: dict[str, list[list[tuple[str | None, str]]]] = {}
        self.points: dict[str, list[dict[str, str]]] = {}
        self.data: dict[str, Any] = {}
        self.tags: Counter[str] = Counter()
        self.attributes: set[str] = set()
        self._table = self._chart = ""
        self._cell: str | None = None
        self._reading = ""
        self._text = ""
        self.feed(file.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self.tags[tag] += 1
        self.attributes.update(values)
        if tag == "table":
            self._table = values["id"] or ""
            self.titles[self._table], self.rows[self._table] = [], []
        elif tag == "th":
            self.titles[self._table].append(values["data-key"] or "")
        elif tag == "tr":
            self.rows[self._table].append([])
        elif tag == "td":
            self._cell, self._reading, self._text = values.get("data-value"), "td", ""
        elif tag == "svg":
            self._chart = values["id"] or ""
            self.points[self._chart] = []
        elif tag == "circle":
            self.points[self._chart].append({k: v or "" for k, v in attrs})
        elif tag == "script" and values.get("id") == "data":
            self._reading, self._text = "data", ""

    def handle_data(self, data: str) -> None:
        if self._reading:
            self._text += data

    def handle_endtag(self, tag: str) -> None:
        if tag == "td":
            self.rows[self._table][-1].append((self._cell, self._text))
        elif tag == "script" and self._reading == "data":
            self.data = json.loads(self._text)
        else:
            return
        self._reading = ""


def read_csv(file: Path) -> list[dict[str, str]]:
    with file.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))
