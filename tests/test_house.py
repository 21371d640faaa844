"""The limits that keep the house readable: folders, files, parameters, and imports one way."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "o3d_sofnn"
ROOMS = ("o3d_sofnn", "filters", "tests", "demos")
CODE = (".py", ".pyi", ".cpp", ".hpp", ".h", ".js", ".css", ".html")
FILES, LINES, PARAMETERS, LEVELS = 12, 300, 7, 11
OPERATORS = {
    "estimate_normals",
    "reconstruct_surface",
    "reconstruct_tiles",
    "fuzzy_c_means",
    "__init__",
}
"""Public functions may have as many options as there are."""
SKIPPED = {"__pycache__", "output"}


def sources() -> list[Path]:
    found = [file for room in ROOMS for file in (ROOT / room).rglob("*") if file.is_file()]
    return [file for file in found if not SKIPPED & set(file.parts) and file.suffix != ".so"]


def modules() -> dict[str, ast.Module]:
    found = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        name = ".".join(file.relative_to(ROOT).with_suffix("").parts)
        found[name.removesuffix(".__init__")] = ast.parse(file.read_text(encoding="utf-8"))
    return found


def imported(tree: ast.Module, known: set[str]) -> set[str]:
    """Return the modules of the package that a module imports when it is imported itself."""
    names = set()
    for node in tree.body:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {f"{node.module}.{alias.name}" for alias in node.names} | {node.module}
    return names & known


def test_no_folder_has_more_files_than_one_can_see() -> None:
    count: dict[Path, int] = {}
    for file in sources():
        count[file.parent] = count.get(file.parent, 0) + 1
    assert {str(f.relative_to(ROOT)): n for f, n in count.items() if n > FILES} == {}


def test_no_file_is_longer_than_one_can_hold() -> None:
    long = {
        str(file.relative_to(ROOT)): n
        for file in sources()
        if file.suffix in CODE
        for n in [file.read_text(encoding="utf-8").count("\n")]
        if n > LINES
    }
    assert long == {}


def test_no_function_has_more_parameters_than_one_can_name() -> None:
    many = {}
    for name, tree in modules().items():
        for node in ast.walk(tree):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                given = node.args
                names = [a.arg for a in [*given.posonlyargs, *given.args, *given.kwonlyargs]]
                names = [each for each in names if each not in ("self", "cls")]
                if len(names) > PARAMETERS and node.name not in OPERATORS:
                    many[f"{name}.{node.name}"] = len(names)
    assert many == {}


def test_imports_run_one_way() -> None:
    trees = modules()
    known = set(trees)
    uses = {name: imported(tree, known) - {name} for name, tree in trees.items()}
    level: dict[str, int] = {}

    def depth(name: str, above: tuple[str, ...]) -> int:
        assert name not in above, f"circle: {' -> '.join([*above[above.index(name) :], name])}"
        if name not in level:
            level[name] = 1 + max((depth(used, (*above, name)) for used in uses[name]), default=0)
        return level[name]

    assert {name: n for name in uses if (n := depth(name, ())) > LEVELS} == {}


@pytest.mark.parametrize("library", ["open3d", "pymeshlab", "matplotlib", "laspy", "pye57"])
def test_libraries_are_imported_where_they_are_needed(library: str) -> None:
    """None is imported with the package; Open3D is known to its adapter and to the peers alone."""
    users = set()
    for name, tree in modules().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                names = [node.module or ""]
            else:
                continue
            if library in {each.partition(".")[0] for each in names}:
                assert node not in tree.body, f"{name} imports {library} with the package"
                users.add(name)
    if library == "open3d":
        assert {name for name in users if ".compare." not in name} == {"o3d_sofnn.adapters"}
