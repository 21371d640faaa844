"""Charts of the report as SVG: error against noise, time against size."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

Row = dict[str, Any]

WIDTH, HEIGHT = 460, 320
LEFT, RIGHT, TOP, BOTTOM = 62, 14, 14, 46
"""Margins around the plotted area."""
LABEL = 50
"""Smallest distance between labels of the horizontal axis."""
COLORS = (
    *("#c22f2f", "#1f6fb2", "#2f9e6e", "#8a63c9", "#c9791a"),
    *("#5f7480", "#b8508f", "#6f7d1c", "#7a4a3a"),
)
"""Colours of the methods in their order, as in the page's light theme."""


@dataclass(frozen=True)
class Chart:
    """The quantities and labels of a chart.

    Attributes
    ----------
    name : str
        Name of the file, and of the element on the page.
    title : str
        Title above the chart.
    x, y : str
        Keys of the rows.
    x_label, y_label : str
        Labels of the axes.
    x_log, y_log : bool
        Whether an axis is logarithmic.
    """

    name: str
    title: str
    x: str
    y: str
    x_label: str
    y_label: str
    x_log: bool = False
    y_log: bool = False

    def takes(self, row: Row) -> bool:
        """Return whether a row counts: noise is varied at one size, size without noise."""
        if row["error"] or row.get(self.y) is None or row.get(self.x) is None:
            return False
        return self.x == "noise" or not row["noise"]


CHARTS = (
    Chart(
        "error-noise",
        "Error against noise",
        "noise",
        "chamfer",
        "noise, % of the diagonal",
        "Chamfer distance, 1/1000 of the diagonal",
        y_log=True,
    ),
    Chart(
        "flipped-noise",
        "Flipped normals against noise",
        "noise",
        "flipped",
        "noise, % of the diagonal",
        "flipped normals, %",
    ),
    Chart(
        "time-size",
        "Time against size",
        "points",
        "seconds",
        "points",
        "time, s",
        x_log=True,
        y_log=True,
    ),
)


def series(chart: Chart, rows: Sequence[Row]) -> dict[str, list[tuple[float, float]]]:
    """Return for every method the median of y for each value of x, in ascending order of x.

    For charts against noise, only inputs and sizes with several noise levels count. For charts
    against size, only the input with the most sizes counts, if it has several: others would add
    points in between.
    """
    rows = [row for row in rows if chart.takes(row)]
    if chart.x == "points":
        sizes: dict[Any, set[int]] = {}
        for row in rows:
            sizes.setdefault(row["input"], set()).add(row["points"])
        several = {name: counts for name, counts in sizes.items() if len(counts) > 1}
        most = max(several, key=lambda name: len(several[name]), default=None)
        rows = [row for row in rows if row["input"] == most]
    if chart.x == "noise":
        levels: dict[tuple[Any, Any], set[float]] = {}
        for row in rows:
            levels.setdefault((row["input"], row["points"]), set()).add(row["noise"])
        rows = [row for row in rows if len(levels[row["input"], row["points"]]) > 1]
    found: dict[str, list[tuple[float, float]]] = {}
    for method in dict.fromkeys(row["method"] for row in rows):
        own = [row for row in rows if row["method"] == method]
        places = sorted({row[chart.x] for row in own})
        found[method] = [
            (x, median(row[chart.y] for row in own if row[chart.x] == x)) for x in places
        ]
    return found


def draw(chart: Chart, rows: Sequence[Row], methods: Sequence[str], titles: dict[str, str]) -> str:
    """Return the chart as an SVG element, or "" if there is nothing to draw.

    Every point has its method and its numbers as data attributes; the class ``m<k>`` of a line is
    the position of its method in ``methods``.

    Parameters
    ----------
    chart : Chart
        The chart.
    rows : sequence of dict
        Results, with the keys ``run.COLUMNS``.
    methods : sequence of str
        All methods, in the order of their colours.
    titles : dict of str to str
        Human-readable names of the methods.
    """
    lines = series(chart, rows)
    points = [point for line in lines.values() for point in line]
    if not points:
        return ""
    across = _Axis([x for x, _ in points], chart.x_log, LEFT, WIDTH - RIGHT)
    # A logarithmic axis has no 0: an exact result is drawn at the bottom.
    up = _Axis([y for _, y in points], chart.y_log, HEIGHT - BOTTOM, TOP)
    parts = [
        f'<svg class="chart" id="{chart.name}" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="{html.escape(chart.title)}">'
    ]
    free = -math.inf
    for value in across.ticks():
        x = across(value)
        parts.append(
            f'<line class="grid" x1="{x:.1f}" x2="{x:.1f}" y1="{TOP}" y2="{HEIGHT - BOTTOM}"/>'
        )
        if x - free >= LABEL:
            free = x
            parts.append(
                f'<text x="{x:.1f}" y="{HEIGHT - BOTTOM + 16}" text-anchor="middle">'
                f"{_short(value)}</text>"
            )
    for value in up.ticks():
        y = up(value)
        parts.append(
            f'<line class="grid" x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{y:.1f}" y2="{y:.1f}"/>'
            f'<text x="{LEFT - 6}" y="{y + 4:.1f}" text-anchor="end">{_short(value)}</text>'
        )
    middle = 0.5 * (TOP + HEIGHT - BOTTOM)
    parts.append(
        f'<text x="{0.5 * (LEFT + WIDTH - RIGHT):.1f}" y="{HEIGHT - 8}" text-anchor="middle">'
        f"{html.escape(chart.x_label)}</text>"
        f'<text x="14" y="{middle:.1f}" text-anchor="middle" '
        f'transform="rotate(-90 14 {middle:.1f})">{html.escape(chart.y_label)}</text>'
    )
    for method, line in lines.items():
        places = [(across(x), up(y)) for x, y in line]
        parts.append(f'<g class="m{methods.index(method)}">')
        parts.append(
            f'<polyline points="{" ".join(f"{x:.1f},{y:.1f}" for x, y in places)}"/>'
            if len(places) > 1
            else ""
        )
        for (x, y), (a, b) in zip(places, line, strict=True):
            text = f"{titles[method]}: {_short(b)} at {_short(a)}"
            parts.append(
                f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3.5" data-method="{method}" '
                f'data-x="{a!r}" data-y="{b!r}"><title>{html.escape(text)}</title></circle>'
            )
        parts.append("</g>")
    parts.append("</svg>")
    return "".join(parts)


class _Axis:
    """Maps numbers to positions in the picture, with a little room at both ends."""

    def __init__(self, values: Sequence[float], log: bool, start: float, stop: float) -> None:
        positive = [value for value in values if value > 0]
        self.log = log and bool(positive)
        if self.log:
            self.low, self.high = math.log10(min(positive)), math.log10(max(positive))
        else:
            self.low, self.high = min(values), max(values)
        room = 0.06 * (self.high - self.low) or 0.5
        self.low, self.high = self.low - room, self.high + room
        if not self.log and min(values) >= 0:
            self.low = max(self.low, -0.05 * self.high)
        self.start, self.stop = start, stop

    def __call__(self, value: float) -> float:
        if self.log:
            value = math.log10(value) if value > 0 else self.low
        return self.start + (self.stop - self.start) * (value - self.low) / (self.high - self.low)

    def ticks(self) -> list[float]:
        """Return round numbers, four to nine of them where possible."""
        if self.log:
            for factors in ((1,), (1, 3), (1, 2, 5), tuple(range(1, 10))):
                found = [
                    factor * 10.0**power
                    for power in range(math.floor(self.low), math.ceil(self.high) + 1)
                    for factor in factors
                ]
                found = [tick for tick in found if self.low <= math.log10(tick) <= self.high]
                if len(found) >= 4:
                    return found
            return found
        raw = (self.high - self.low) / 5.0
        power = 10.0 ** math.floor(math.log10(raw))
        step = next(step * power for step in (1, 2, 5, 10) if step * power >= raw)
        first = math.ceil(self.low / step)
        return [k * step for k in range(first, math.floor(self.high / step) + 1)]


def _short(value: float) -> str:
    if value and (abs(value) >= 1e6 or abs(value) < 1e-3):
        return f"{value:.1e}"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
