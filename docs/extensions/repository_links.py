"""Links of a page to files beside the documentation are shown as the names of these files.

In the repository they lead somewhere; on the site there is nothing for them to lead to.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

_LINK = re.compile(r"(?<!!)\[(?P<text>[^]]*)\]\((?P<file>\.\./[^)#\s]+)(#[^)\s]*)?\)")


def setup(app: Any) -> dict[str, bool]:
    """Register the step with Sphinx."""
    app.connect("source-read", _replace)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _replace(app: Any, name: str, source: list[str]) -> None:
    page = Path(app.env.doc2path(name))
    if page.suffix == ".md":
        source[0] = _LINK.sub(lambda link: _shown(link, page, Path(app.srcdir)), source[0])


def _shown(link: re.Match[str], page: Path, root: Path) -> str:
    target = (page.parent / link["file"]).resolve()
    if target.is_relative_to(root.resolve()):
        return link[0]
    inside = target.relative_to(root.resolve().parent)
    text = link["text"].strip("`")
    if str(inside).endswith(text):
        return f"`{inside}`"
    return f"{link['text']} (`{inside}`)"
