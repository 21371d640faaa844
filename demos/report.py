"""One HTML file with everything in it: tables that sort, and pictures. It opens offline."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable
from pathlib import Path
from statistics import median
from typing import Any

from measure import FIGURES

Row = dict[str, Any]

SMALLER_IS_BETTER = ("seconds", "input_mean", "chamfer", "hausdorff", "flipped")
SHARES = ("watertight", "manifold")

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>o3d_sofnn beside its peers</title>
<style>
:root {{ color-scheme: light dark; --line: #8884; --head: #8882;
  --bad: light-dark(#b03020, #ff8a7a); --best: light-dark(#1d7a46, #5fd08a); }}
body {{ font: 15px/1.45 system-ui, sans-serif; max-width: 1500px; margin: 0 auto; padding: 1rem; }}
.scroll {{ overflow-x: auto; }}
table {{ border-collapse: collapse; font-variant-numeric: tabular-nums; white-space: nowrap; }}
th, td {{ padding: .3rem .6rem; border-bottom: 1px solid var(--line); text-align: right; }}
th:first-child, td:first-child, td.text, th.text {{ text-align: left; }}
th {{ background: var(--head); white-space: normal; vertical-align: bottom; }}
th button {{ all: unset; cursor: pointer; }}
th button:focus-visible {{ outline: 2px solid; }}
th[aria-sort=ascending] button::after {{ content: " \\25B2"; }}
th[aria-sort=descending] button::after {{ content: " \\25BC"; }}
tr.ours td {{ font-weight: 600; }}
td.best {{ color: var(--best); }}
td.failed {{ color: var(--bad); text-align: left; white-space: normal; }}
figure {{ margin: 1.5rem 0; }}
img {{ max-width: 100%; height: auto; background: #fff; border-radius: 6px; }}
.wide img {{ max-width: none; height: auto; }}
@media (max-width: 700px) {{ body {{ padding: .6rem; font-size: 14px; }} }}
</style>
</head>
<body>
<h1>o3d_sofnn beside its peers</h1>
<p>Points without normals in, a mesh out; every method in a process of its own with its defaults.
Distances are in thousandths of the diagonal of the input. Memory includes the libraries.
A click on a title sorts.</p>
{note}
<h2>Median over the inputs</h2>
<p>Only of inputs on which the method did not fail; the last column counts them.</p>
{summary}
<h2>All figures</h2>
{results}
<h2>Pictures</h2>
{pictures}
<script>
for (const button of document.querySelectorAll("th button")) {{
  button.addEventListener("click", () => {{
    const head = button.closest("th"), table = head.closest("table");
    const column = [...head.parentNode.children].indexOf(head);
    const down = head.getAttribute("aria-sort") === "ascending";
    for (const other of table.querySelectorAll("th")) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", down ? "descending" : "ascending");
    const value = row => row.children[column]?.dataset.value ?? "";
    const rows = [...table.tBodies[0].rows];
    rows.sort((a, b) => {{
      const x = value(a), y = value(b);
      if (x === "" || y === "") return (x === "") - (y === "");
      const order = isNaN(x) || isNaN(y) ? x.localeCompare(y) : x - y;
      return down ? -order : order;
    }});
    table.tBodies[0].append(...rows);
  }});
}}
</script>
</body>
</html>
"""


def write(path: Path, rows: list[Row], images: dict[str, Path], note: str = "") -> None:
    """Write the report.

    Parameters
    ----------
    path : Path
        The HTML file.
    rows : list of dict
        ``input``, ``method``, ``error`` ("" for none) and the keys of ``FIGURES``, None where
        there is no number.
    images : dict of str to Path
        Captions and PNG files.
    note : str, optional
        A sentence above everything.
    """
    figures = [key for key in FIGURES if any(row.get(key) is not None for row in rows)]
    text = PAGE.format(
        note=f"<p><strong>{html.escape(note)}</strong></p>" if note else "",
        summary=_table("summary", ["method"], [*figures, "inputs"], summarise(rows)),
        results=_table("results", ["input", "method"], figures, rows),
        pictures="\n".join(_picture(caption, file) for caption, file in images.items()),
    )
    path.write_text(text, encoding="utf-8")


def summarise(rows: Iterable[Row]) -> list[Row]:
    """Return one row a method: medians of its figures, shares of yes for yes-or-no figures."""
    rows = list(rows)
    summary = []
    for method in dict.fromkeys(row["method"] for row in rows):
        own = [row for row in rows if row["method"] == method]
        good = [row for row in own if not row["error"]]
        line: Row = {"method": method, "error": "" if good else "failed on every input"}
        for key in FIGURES:
            values = [row[key] for row in good if row.get(key) is not None]
            if values:
                line[key] = sum(values) / len(values) if key in SHARES else median(values)
        line["inputs"] = len(good)
        summary.append(line)
    return summary


def _table(name: str, texts: list[str], figures: list[str], rows: list[Row]) -> str:
    titles = "".join(
        f'<th scope="col"{" class=text" if key in texts else ""}>'
        f'<button type="button">{html.escape(FIGURES.get(key, key))}</button></th>'
        for key in [*texts, *figures]
    )
    body = "\n".join(_line(row, texts, figures, rows) for row in rows)
    return (
        f'<div class="scroll"><table id="{name}"><thead><tr>{titles}</tr></thead>'
        f"<tbody>\n{body}\n</tbody></table></div>"
    )


def _line(row: Row, texts: list[str], figures: list[str], rows: list[Row]) -> str:
    cells = []
    for key in texts:
        text = html.escape(str(row[key]))
        cells.append(f'<td class="text" data-value="{text}">{text}</td>')
    if row["error"]:
        message = html.escape(row["error"])
        cells.append(f'<td class="failed" colspan="{len(figures)}">failed: {message}</td>')
    else:
        rivals = [
            other for other in rows if not other["error"] and other.get("input") == row.get("input")
        ]
        cells += [_cell(key, row.get(key), rivals) for key in figures]
    kind = ' class="ours"' if row["method"] == "ours" else ""
    return f"<tr{kind}>{''.join(cells)}</tr>"


def _cell(key: str, value: float | None, rivals: list[Row]) -> str:
    if value is None:
        return '<td data-value="">–</td>'
    best = key in SMALLER_IS_BETTER and value <= min(
        rival[key] for rival in rivals if rival.get(key) is not None
    )
    kind = ' class="best"' if best else ""
    return f'<td{kind} data-value="{value!r}">{_show(key, value)}</td>'


def _show(key: str, value: float) -> str:
    if key in SHARES:
        return {0.0: "no", 1.0: "yes"}.get(value, f"{100 * value:.0f} %")
    if key in ("triangles", "components", "holes", "inputs", "peak_mb"):
        return f"{value:,.0f}"
    return f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"


def _picture(caption: str, file: Path) -> str:
    data = base64.b64encode(file.read_bytes()).decode("ascii")
    text = html.escape(caption)
    return (
        f"<figure><figcaption>{text}</figcaption>"
        f'<img alt="{text}" src="data:image/png;base64,{data}"></figure>'
    )
