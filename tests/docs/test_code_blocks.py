"""Every code block of the README and of the documentation runs, or says why it is not run."""

from __future__ import annotations

from pathlib import Path

import pytest
from code_blocks import SHOWN, Block, blocks, commands, pages, run_python

from o3d_sofnn.cli.main import main

ROOT = Path(__file__).parents[2]
PAGES = pages(ROOT)


def run_shell(block: Block) -> None:
    for words in commands(block):
        try:
            code = main(words)
        except SystemExit as end:  # --help
            code = end.code
        assert not code, f"{block.page}:{block.line}: o3d-sofnn {' '.join(words)}: exit code {code}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_the_blocks_of_a_page_run(page, workplace, capsys):
    names = {"__name__": page.stem}
    for block in blocks(page):
        assert block.language in {"python", "sh"} | SHOWN, f"{page}:{block.line}: {block.language}"
        if block.reason is not None:
            continue
        if block.language == "python":
            pytest.importorskip("pymeshlab") if "pymeshlab" in block.code else None
            run_python(block, names)
        elif block.language == "sh":
            run_shell(block)


def test_there_are_blocks_to_run():
    run = [block for page in PAGES for block in blocks(page) if block.reason is None]
    assert sum(block.language == "python" for block in run) > 10
    assert sum(len(list(commands(block))) for block in run if block.language == "sh") > 10


def test_a_block_that_fails_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("a\n\n```python\nx = 1\n1 / 0\n```\n\n```sh\nmake demo\n```\n")
    first, second = blocks(page)
    with pytest.raises(ZeroDivisionError) as found:
        run_python(first, {})
    assert (found.traceback[-1].lineno or 0) + 1 == 5
    with pytest.raises(ValueError, match="make demo"):
        list(commands(second))


def test_only_the_block_below_a_mark_is_left_out(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "<!-- not run: needs root -->\n```sh\nsudo x\n```\n```sh\no3d-sofnn -h\n```\n"
        "<!-- not run: needs root -->\ntext\n```python\n1\n```\n```{note}\nx\n```\n"
    )
    assert [block.reason for block in blocks(page)] == ["needs root", None, None]
