"""The fuzzer of clouds: a short run of it, and that it finds what it looks for."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from demo_runs import DEMOS, Run, run_demo

from o3d_sofnn import pipeline


@pytest.fixture
def fuzzer(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(DEMOS / "benchmarks" / "fuzz"))
    import fuzz_clouds

    yield fuzz_clouds
    for name in ("fuzz_clouds", "odd_clouds"):
        sys.modules.pop(name)


@pytest.fixture
def run(tmp_path: Path) -> Run:
    return partial(run_demo, tmp_path)


def test_odd_clouds_end_as_promised(run: Run, fuzzer) -> None:
    done = run("benchmarks/fuzz/fuzz_clouds", "--first", 20_000, "--calls", 100, "--jobs", 1)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [line.split("|")[1:-1] for line in done.stdout.splitlines() if line.startswith("| ")]
    assert [row[0].strip() for row in rows] == ["cloud", *fuzzer.odd_clouds.KINDS, "all"]
    total = [int(count) for count in rows[-1][1:]]
    assert sum(total) == 100
    assert min(total[:4]) > 0, "normals, closed and open meshes, and errors"
    assert total[4] == 0


def test_calls_are_the_same_again(fuzzer) -> None:
    odd_clouds = fuzzer.odd_clouds
    for seed in range(40):
        one, other = odd_clouds.case(seed), odd_clouds.case(seed)
        np.testing.assert_array_equal(one.points, other.points)
        assert one.points.shape[1] == 3
        assert 4 <= len(one.points) <= 2 * odd_clouds.MOST
        assert repr(one.options) == repr(other.options)


@pytest.mark.parametrize(
    ("broken", "fault"),
    [
        (lambda *_, **__: 1 / 0, "ZeroDivisionError"),
        (lambda *_, **__: np.float64(0.0) / np.float64(0.0), "RuntimeWarning"),
        (lambda *_, **__: (_ for _ in ()).throw(ValueError("no")), "ValueError without name"),
    ],
)
def test_faults_are_found(broken, fault, monkeypatch, fuzzer) -> None:
    monkeypatch.setattr(pipeline, "estimate_normals", broken)
    monkeypatch.setattr(pipeline, "reconstruct_surface", broken)
    assert fuzzer.one_call(3).startswith(fault)


def test_a_call_that_ends_the_process_is_a_crash(monkeypatch, fuzzer, tmp_path) -> None:
    script = tmp_path / "fuzz.py"
    script.write_text(
        "import os, sys\n"
        "for seed in range(int(sys.argv[2]), int(sys.argv[3])):\n"
        "    os.abort() if seed in (11, 12) else print(seed, 'mesh', sep='\\t', flush=True)\n"
    )
    monkeypatch.setattr(fuzzer, "__file__", str(script))
    outcomes = fuzzer.run_batch(range(10, 15))
    assert [outcomes[seed] for seed in (10, 13, 14)] == ["mesh"] * 3
    assert [outcomes[seed] for seed in (11, 12)] == ["crash, exit code -6"] * 2
