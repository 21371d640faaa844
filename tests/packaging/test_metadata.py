"""What an installer reads: which Open3D each system gets, and which Pythons there are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

tomllib = pytest.importorskip("tomllib", reason="Python 3.10 has no reader of TOML")

ROOT = Path(__file__).parents[2]
SYSTEMS = {
    ("Linux", "x86_64"): "open3d-cpu",
    ("Linux", "aarch64"): "open3d",
    ("Windows", "AMD64"): "open3d",
    ("Darwin", "arm64"): "open3d",
    ("Darwin", "x86_64"): "open3d",
}


@pytest.fixture(scope="module")
def settings() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(("system", "machine"), SYSTEMS)
def test_every_system_gets_one_open3d(settings: dict[str, Any], system: str, machine: str) -> None:
    extra = settings["project"]["optional-dependencies"]["open3d"]
    here = {"platform_system": system, "platform_machine": machine}
    wanted = [Requirement(each) for each in extra]
    names = [each.name for each in wanted if each.marker is None or each.marker.evaluate(here)]
    assert names == [SYSTEMS[system, machine]]


def test_classifiers_name_every_python_that_is_allowed(settings: dict[str, Any]) -> None:
    project = settings["project"]
    prefix = "Programming Language :: Python :: 3."
    minors = [int(c[len(prefix) :]) for c in project["classifiers"] if c.startswith(prefix)]
    assert minors == list(range(minors[0], minors[-1] + 1))
    allowed = SpecifierSet(project["requires-python"])
    assert [allowed.contains(f"3.{minor}") for minor in (minors[0] - 1, minors[0])] == [False, True]


def test_there_is_a_wheel_for_every_python(settings: dict[str, Any]) -> None:
    """One for each Python before that of the stable ABI, and one for this and all later ones."""
    least = next(iter(SpecifierSet(settings["project"]["requires-python"]))).version
    stable = settings["tool"]["scikit-build"]["wheel"]["py-api"]
    assert stable == "cp312", "nanobind is linked in, which takes the stable ABI of Python 3.12"
    minors = range(int(least.split(".")[1]), int(stable[3:]) + 1)
    built = settings["tool"]["cibuildwheel"]["build"].split()
    assert built == [f"cp3{minor}-*" for minor in minors]
