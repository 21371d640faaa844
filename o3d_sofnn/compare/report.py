"""One HTML file that opens offline: panes that turn together, charts, tables."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from statistics import median
from typing import Any

from o3d_sofnn.compare import charts, colors
from o3d_sofnn.compare.evaluate import METHODS, WORST
from o3d_sofnn.compare.measure import FIGURES, YES_OR_NO, show, turned
from o3d_sofnn.compare.scene import Scene, pack
from o3d_sofnn.files.point_files import open_atomic

Row = dict[str, Any]

TITLES = {
    "": "–",
    "input": "input",
    "ours": "o3d_sofnn",
    "open3d_poisson": "Open3D Poisson",
    "open3d_ball_pivoting": "Open3D ball pivoting",
    "open3d_alpha_shape": "Open3D alpha shape",
    "meshlab_poisson": "MeshLab screened Poisson",
    "meshlab_ball_pivoting": "MeshLab ball pivoting",
    "meshlab_rimls": "MeshLab RIMLS",
    "meshlab_apss": "MeshLab APSS",
    "meshlab_sofnn": "o3d_sofnn in MeshLab",
}
"""Titles of the methods, and of the pane of the points."""
SMALLER_IS_BETTER = {
    *("seconds", "peak_mb", "input_mean", "input_max", "chamfer", "hausdorff", "flipped")
}
LARGER_IS_BETTER = {"f_score", "normal_consistency"}
TEXTS = ("input", "method")
TURNED = ", with the sides turned once"
"""After the title of a method, in the second row of one whose sides are wrong as a whole."""


def write(
    path: Path, rows: list[Row], scenes: list[Scene], note: str = "", machine: str = ""
) -> None:
    """Write the report, and its charts as SVG files beside it.

    Parameters
    ----------
    path : Path
        The HTML file.
    rows : list of dict
        Results with the keys ``run.COLUMNS``; None where there is no number.
    scenes : list of Scene
        Contents of the panes.
    note : str, default ""
        A sentence above everything.
    machine : str, default ""
        What the methods ran with, and on what.

    Raises
    ------
    OSError
        A file cannot be written; the message names it.
    """
    methods = _methods(rows)
    drawn = {chart: charts.draw(chart, rows, list(METHODS), TITLES) for chart in charts.CHARTS}
    for chart, svg in drawn.items():
        if svg:
            save(path.with_name(f"{chart.name}.svg"), _standalone(svg))
    figures = [key for key in FIGURES if any(row.get(key) is not None for row in rows)]
    heat = ", ".join(f"rgb{color}" for color in colors.HEAT)
    own = {
        "style": _filled(_asset("report.css"), {"heat": heat}),
        "viewer": _asset("viewer.js"),
        "script": _asset("report.js"),
    }
    parts = {
        **own,
        "policy": html.escape(_policy([own["style"]], [own["viewer"], own["script"]])),
        "note": f'<p class="note">{html.escape(note)}</p>' if note else "",
        "machine": f"<p>{html.escape(machine)}</p>" if machine else "",
        "failures": _failures(rows),
        "legend": "".join(
            f'<span class="m{list(METHODS).index(method)}">{html.escape(TITLES[method])}</span>'
            for method in methods
        ),
        "no_charts": "" if any(drawn.values()) else " hidden",
        "charts": "".join(
            f"<figure><figcaption>{html.escape(chart.title)}</figcaption>{svg}</figure>"
            for chart, svg in drawn.items()
            if svg
        ),
        "summary": _table("summary", ["method", "runs", "failed", *figures], summarise(rows)),
        "results": _table("results", ["method", "input", "points", "noise", *figures], _both(rows)),
        "worst": f"{1000 * WORST:g}",
        "scenes": json.dumps(
            {"heat": colors.HEAT, "scenes": [pack(scene, TITLES) for scene in scenes]},
            separators=(",", ":"),
        ).replace("<", "\\u003c"),
    }
    save(path, _filled(_asset("report.html"), parts))


def save(path: Path, data: bytes | str) -> None:
    """Write a file whole or not at all; undecodable bytes of file names are escaped.

    Raises
    ------
    OSError
        The message names the file.
    """
    with open_atomic(path) as stream:
        stream.write(data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data)


def _filled(template: str, parts: dict[str, str]) -> str:
    """Fill all placeholders ``{{name}}`` at once: braces in a part (a file name) remain text."""
    return re.sub(r"\{\{(\w+)\}\}", lambda place: parts[place[1]], template)


def _policy(styles: list[str], scripts: list[str]) -> str:
    """Return a content security policy: only these run, and nothing is fetched or sent."""

    def hashes(texts: list[str]) -> str:
        digests = (hashlib.sha256(text.encode()).digest() for text in texts)
        return " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)

    return (
        f"default-src 'none'; img-src data:; style-src {hashes(styles)}; "
        f"script-src {hashes(scripts)}; base-uri 'none'; form-action 'none'"
    )


def summarise(rows: Iterable[Row]) -> list[Row]:
    """Return one row per method: medians of its figures, and shares of yes for yes-or-no ones.

    A method whose sides are wrong as a whole on some clouds has a second row, with those turned.
    """
    rows = list(rows)
    summary = []
    for method in _methods(rows):
        own = [row for row in rows if row["method"] == method]
        summary.append(_medians(method, own))
        again = [turned(row) or row for row in own]
        if again != own:
            summary.append(_medians(method, again) | {"turned": True})
    return summary


def _medians(method: str, own: list[Row]) -> Row:
    good = [row for row in own if not row["error"]]
    line: Row = {"method": method, "error": "" if good else "failed on every cloud"}
    line |= {"runs": len(own), "failed": len(own) - len(good)}
    for key in FIGURES:
        values = [row[key] for row in good if row.get(key) is not None]
        if values:
            line[key] = sum(values) / len(values) if key in YES_OR_NO else median(values)
    return line


def _both(rows: list[Row]) -> list[Row]:
    """Return the rows, and behind each whose sides are wrong as a whole what turning them gives."""
    found = []
    for row in rows:
        again = turned(row)
        found += [row] if again is None else [row, again | {"turned": True}]
    return found


def _methods(rows: Iterable[Row]) -> list[str]:
    """Return the methods in their order, without the "" of an input that was not read."""
    return [method for method in dict.fromkeys(row["method"] for row in rows) if method]


def _asset(name: str) -> str:
    return resources.files(__package__).joinpath("page", name).read_text(encoding="utf-8")


def _standalone(svg: str) -> str:
    """Return a chart as a standalone file on white."""
    style = "text{font:11px sans-serif}polyline{fill:none;stroke-width:2}.grid{stroke:#ddd}"
    for k, color in enumerate(charts.COLORS):
        style += f".m{k} polyline{{stroke:{color}}}.m{k} circle{{fill:{color}}}"
    head = '<svg xmlns="http://www.w3.org/2000/svg" style="background:#fff" '
    first, rest = svg.removeprefix("<svg ").split(">", 1)
    return f"{head}{first}><style>{style}</style>{rest}"


def failures(rows: Iterable[Row]) -> list[str]:
    """Return a line for every failure: cloud, method, message."""
    lines = []
    for row in rows:
        if row["error"]:
            points = "" if row["points"] is None else f", {row['points']:,} points"
            noise = "" if row["noise"] is None else f", {row['noise']:g} % noise"
            method = f"{TITLES[row['method']]}: " if row["method"] else ""
            lines.append(f"{row['input']}{points}{noise}: {method}{row['error']}")
    return lines


def _failures(rows: list[Row]) -> str:
    failed = failures(rows)
    if not failed:
        return ""
    lines = "".join(f"<li>{html.escape(line)}</li>" for line in failed)
    return (
        f'<details class="failures"><summary>{len(failed)} of {len(rows)} runs failed</summary>'
        f"<ul>{lines}</ul></details>"
    )


def _table(name: str, columns: list[str], rows: list[Row]) -> str:
    titles = "".join(
        f'<th scope="col" data-key="{key}"{" class=text" if key in TEXTS else ""}>'
        f'<button type="button">{html.escape(FIGURES.get(key, _HEADS.get(key, key)))}</button></th>'
        for key in columns
    )
    body = "\n".join(_line(row, columns, rows) for row in rows)
    return (
        f'<div class="scroll" tabindex="0"><table id="{name}"><thead><tr>{titles}</tr></thead>'
        f"<tbody>\n{body}\n</tbody></table></div>"
    )


_HEADS = {"noise": "noise, %"}


def _line(row: Row, columns: list[str], rows: list[Row]) -> str:
    own = ("input", "points", "noise")
    rivals = [
        other
        for other in rows
        if not other["error"]
        and not other.get("turned")
        and all(other.get(key) == row.get(key) for key in own)
    ]
    cells = []
    for place, key in enumerate(columns):
        if row["error"] and key in FIGURES:
            message = html.escape(row["error"])
            span = len(columns) - place
            cells.append(f'<td class="failed" colspan="{span}">failed: {message}</td>')
            break
        if key in TEXTS:
            cells.append(_text(row[key], _title(row) if key == "method" else row[key]))
        else:
            cells.append(_cell(key, row.get(key), [] if row.get("turned") else rivals))
    kind = ' class="ours"' if row["method"] == "ours" else ""
    return f"<tr{kind}>{''.join(cells)}</tr>"


def _cell(key: str, value: Any, rivals: list[Row]) -> str:
    if value is None:
        return '<td data-value="">–</td>'
    known = [rival[key] for rival in rivals if rival.get(key) is not None]
    best = len(known) > 1 and (
        (key in SMALLER_IS_BETTER and value <= min(known))
        or (key in LARGER_IS_BETTER and value >= max(known))
    )
    kind = ' class="best"' if best else ""
    return f'<td{kind} data-value="{value!r}">{show(key, value)}</td>'


def _title(row: Row) -> str:
    return TITLES[row["method"]] + (TURNED if row.get("turned") else "")


def _text(value: str, shown: str) -> str:
    return f'<td class="text" data-value="{html.escape(value)}">{html.escape(shown)}</td>'
