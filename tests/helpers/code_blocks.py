"""The code blocks of Markdown pages, and a runner for them."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

NOT_RUN = re.compile(r"<!-- not run: (\S.*) -->")
FENCE = re.compile(r"(?P<indent> *)(?P<ticks>`{3,})(?P<language>.*)")
SHOWN = {"", "text", "bibtex"}
"""Languages of blocks that hold nothing to run."""


def pages(root: Path) -> list[Path]:
    """Return the README and all pages of the documentation."""
    found = sorted((root / "docs").rglob("*.md"))
    return [
        root / "README.md",
        root / "CONTRIBUTING.md",
        *(page for page in found if "_build" not in page.relative_to(root).parts),
    ]


@dataclass(frozen=True)
class Block:
    """One fenced block.

    Attributes
    ----------
    page : Path
        The page it is on.
    line : int
        Of its first line of code, from 1.
    language : str
        As written after the fence.
    code : str
        What is between the fences.
    reason : str, optional
        Why the page says that it is not run.
    """

    page: Path
    line: int
    language: str
    code: str
    reason: str | None = None


def blocks(page: Path) -> Iterator[Block]:
    """Yield the fenced blocks of a page that hold code, directives of MyST left out."""
    lines = page.read_text(encoding="utf-8").splitlines()
    number, reason = 0, None
    while number < len(lines):
        fence = FENCE.fullmatch(lines[number])
        mark = NOT_RUN.fullmatch(lines[number].strip())
        number += 1
        if fence is None:
            if mark or lines[number - 1].strip():
                reason = mark[1] if mark else None
            continue
        start = number
        while lines[number].strip() != fence["ticks"]:
            number += 1
        language = fence["language"].strip()
        if not language.startswith("{"):
            code = "\n".join(lines[start:number]) + "\n"
            yield Block(page, start + 1, language, code, reason)
        number, reason = number + 1, None


def run_python(block: Block, names: dict[str, Any]) -> None:
    """Run a block in the names that the blocks before it left; errors name page and line."""
    code = "\n" * (block.line - 1) + block.code
    exec(compile(code, str(block.page), "exec"), names)


def commands(block: Block) -> Iterator[list[str]]:
    """Yield the arguments of each ``o3d-sofnn`` line of a block of shell.

    Raises
    ------
    ValueError
        There is another command: such a block must say that it is not run.
    """
    for line in block.code.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if not words:
            continue
        if words[0] != "o3d-sofnn":
            raise ValueError(f"{block.page}:{block.line}: not a command of ours: {line}")
        yield words[1:]
