"""The bar of tqdm, where that is installed, and our own where it is not."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapes

import o3d_sofnn
from o3d_sofnn.progress import NoProgress, ProgressBar, TimedBar, make_bar, make_progress

POINTS = shapes.torus(400).points


def with_tqdm() -> type:
    return pytest.importorskip("tqdm.auto", reason="tqdm is not installed").tqdm


def without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)


class Written:
    """What a bar of tqdm is asked for."""

    def __init__(self, **options: Any) -> None:
        self.n, self.closed, self.disable, self.shown = 0, False, False, []
        assert options["total"] == 100

    def set_description(self, text: str) -> None:
        self.shown.append((self.n, text))

    def close(self) -> None:
        self.closed = True


def test_a_bar_shows_what_changes_and_begins_anew_after_its_end() -> None:
    made: list[Written] = []

    def make(**options: Any) -> Written:
        made.append(Written(**options))
        return made[-1]

    bar = TimedBar(make)
    bar.close()
    assert made == []
    for fraction, text in ((0.0, "a"), (0.001, "a"), (0.5, "a\nb"), (2.0, "c")):
        bar(fraction, text)
    bar.close()
    bar.close()
    bar(0.25, "d")
    assert [each.shown for each in made] == [[(0, "a"), (50, "a b"), (100, "c")], [(25, "d")]]
    assert [each.closed for each in made] == [True, False]


def test_a_bar_that_cannot_be_drawn_does_not_end_the_work() -> None:
    def fail(self: Written, text: str) -> None:
        raise BrokenPipeError

    broken = type("Broken", (Written,), {"set_description": fail})
    made: list[Written] = []
    bar = TimedBar(lambda **options: made.append(broken(**options)) or made[-1])
    bar(0.1, "first")
    bar(0.2, "second")
    bar.close()
    assert len(made) == 1
    assert made[0].disable


def test_with_tqdm_the_time_left_is_said(capfd: pytest.CaptureFixture[str]) -> None:
    with_tqdm()
    assert isinstance(make_bar(), TimedBar)
    o3d_sofnn.estimate_normals(POINTS, print_progress=True)
    out, err = capfd.readouterr()
    assert out == ""
    assert "done: 100%" in err
    assert "00:0" in err
    assert err.endswith("\n")


def test_without_tqdm_the_bar_is_our_own(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    without(monkeypatch)
    assert isinstance(make_bar(), ProgressBar)
    o3d_sofnn.estimate_normals(POINTS, print_progress=True)
    assert "100 % done" in capfd.readouterr().err


@pytest.mark.parametrize("prepare", [lambda monkeypatch: with_tqdm(), without])
def test_results_and_lines_are_the_same_with_and_without(
    prepare: Callable[[pytest.MonkeyPatch], object], monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare(monkeypatch)
    expected = o3d_sofnn.estimate_normals(POINTS)
    found = o3d_sofnn.estimate_normals(POINTS, print_progress=True)
    np.testing.assert_array_equal(found, expected)
    monkeypatch.setattr(sys, "stdout", io.StringIO())
    progress = make_progress("plain")
    progress(0.42, "text")
    progress.close()
    assert sys.stdout.getvalue() == "PROGRESS 42 text\n"


def test_a_terminal_that_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    with_tqdm()
    read, write = os.pipe()
    os.close(read)
    with monkeypatch.context() as patch:
        stream = open(write, "w")  # noqa: SIM115 - closing it fails, as writing does
        patch.setattr(sys, "stderr", stream)
        bar = make_bar()
        bar(0.1, "first")
        bar(0.2, "second")
        bar.close()
    with pytest.raises(BrokenPipeError):
        stream.close()


def test_without_a_standard_error_stream_there_is_no_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", None)
    assert isinstance(make_bar(), NoProgress)
