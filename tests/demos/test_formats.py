"""The program behind docs/formats.md, on the files that it generates."""

from __future__ import annotations

import re
import sys
from collections import Counter
from pathlib import Path

import pytest
from demo_runs import DEMOS

from o3d_sofnn.compare import isolated

for library in ("laspy", "plyfile", "pye57", "trimesh"):
    pytest.importorskip(library)


@pytest.fixture
def formats(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(DEMOS / "benchmarks"))
    import formats

    yield formats
    for name in ("formats", "format_files", "format_oracles", "fuzz_seeds"):
        sys.modules.pop(name)


def test_no_file_is_read_wrong(formats, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    made = formats.format_files.make(tmp_path)
    assert len({path.name for path in made}) == len(made) > 90
    rows = []
    for path in made:
        # Open3D, which reads PCD there, may end the interpreter.
        alone = path.suffix == ".pcd"
        truth = None if alone else formats.format_oracles.points_of(path)
        rows.append(formats.row_of(path, truth))
    assert [str(row) for row in rows if row.kind == formats.WRONG] == []
    kinds = Counter(row.kind for row in rows)
    assert kinds["exactly"] > 55
    assert kinds["refused"] > 30
    assert kinds["lost"] > 3
    unchecked = {row.name for row in rows if "no other reader" in row.result}
    assert unchecked <= {path.name for path in made if path.suffix == ".pcd"}
    assert not [row for row in rows if str(tmp_path) in str(row) or "\n" in str(row)]


def test_the_page_has_what_the_program_finds(formats, tmp_path: Path, monkeypatch, capfd) -> None:
    def call(function, *args, timeout):
        if function is formats.meshlab_of:
            return isolated.Outcome(None, "crashed (SIGSEGV)", 0.0, None)
        return isolated.Outcome(function(*args), None, 0.0, None)

    monkeypatch.setattr(formats.isolated, "call", call)
    monkeypatch.setattr(formats.format_files, "make", lambda folder: [])
    (tmp_path / "given").mkdir()
    (tmp_path / "given" / "bad.xyz").write_text("no | scan\n")
    (tmp_path / "given" / "good.xyz").write_text("0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n")
    page = tmp_path / "page.md"
    arguments = ["formats", str(tmp_path / "given"), "--out", str(page)]
    monkeypatch.setattr(sys, "argv", arguments)
    assert formats.main() == 0
    lines = page.read_text().splitlines()
    assert "2 files: 1 are read exactly, 0 with" in page.read_text()
    assert lines[-1] == "| `good.xyz` | 5 points | exactly | ends with it |"
    assert re.match(r"\| `bad\.xyz` \|  \| refused: .*'no / scan' \|  \|", lines[-2])
    # What should not be is told, and no page written.
    page.unlink()
    monkeypatch.setattr(formats, "_same", lambda one, other: False)
    assert formats.main() == 1
    assert "| WRONG: 5 points, another reader has other 5 |" in capfd.readouterr().err
    assert not page.exists()
