"""Links and pictures of the README and of the documentation lead to files that are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from code_blocks import pages

ROOT = Path(__file__).parents[2]
LINK = re.compile(r"\]\(([^)\s]+)\)")
MOST_BYTES = 400_000


def targets(page: Path) -> list[str]:
    """Return the relative targets of a page; blocks of code hold none."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    found = [link.partition("#")[0] for link in LINK.findall(text)]
    return [link for link in found if link and "://" not in link]


@pytest.mark.parametrize("page", pages(ROOT), ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    missing = [link for link in targets(page) if not (page.parent / link).exists()]
    assert not missing


def test_pictures_are_small_and_shown():
    pictures = set((ROOT / "docs").rglob("*.png"))
    built = {path for path in pictures if "_build" in path.parts}
    shown = {(page.parent / link).resolve() for page in pages(ROOT) for link in targets(page)}
    assert pictures - built <= shown
    assert all(path.stat().st_size < MOST_BYTES for path in pictures - built)
