"""A short run of the fuzzer of options, command lines, filters, signals and memory."""

from __future__ import annotations

import re
import sys

import pytest
from demo_runs import DEMOS

from o3d_sofnn.cli import main

pytest.importorskip("open3d")


@pytest.fixture
def fuzzer(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(DEMOS / "benchmarks" / "fuzz"))
    import fuzz_process

    yield fuzz_process
    for name in ("fuzz_process", "odd_values"):
        sys.modules.pop(name)


@pytest.mark.parametrize(
    ("campaign", "numbers", "expected"),
    [
        ("options", range(100), {"done", "ValueError"}),
        ("filters", range(80), {"done", "PyMeshLabException"}),
        ("commands", range(60), {"done", "exit 1", "exit 2"}),
        ("signals", [7], {"signal"}),  # SIGTERM after 0.28 s
        ("memory", [2], {"exit 1"}),  # 494 MB
    ],
)
def test_nothing_ends_as_it_must_not(fuzzer, campaign, numbers, expected):
    if campaign == "filters":
        pytest.importorskip("pymeshlab")
    ends = {number: fuzzer.end_of(campaign, 1, number) for number in numbers}
    assert {number: end for number, end in ends.items() if end not in fuzzer.FINE} == {}
    assert set(ends.values()) == expected


@pytest.mark.parametrize("command", ["normals", "reconstruct", "compare"])
def test_no_option_is_left_out(fuzzer, command, capsys):
    with pytest.raises(SystemExit):
        main.main([command, "--help"])
    assert set(re.findall("--[a-z-]+", capsys.readouterr().out)) <= {*fuzzer.FLAGS, "--help"}


def test_a_crash_is_told_from_an_error(fuzzer, monkeypatch):
    """In a process of its own; the others of its batch are run again."""

    def call(function, campaign, seed, numbers, *, timeout):
        alone = function is fuzzer.end_of
        if alone and numbers != 1:
            return fuzzer.isolated.Outcome("done", None, 0.0, None)
        return fuzzer.isolated.Outcome(None, "crashed (SIGSEGV)", 0.0, None)

    monkeypatch.setattr(fuzzer.isolated, "call", call)
    found = list(fuzzer.ends("options", 0, 3))
    assert found == [(0, "done"), (1, "crashed (SIGSEGV)"), (2, "done")]
