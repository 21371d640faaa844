"""Files of every kind through Python, the command line and MeshLab: what is read, lost, refused.

Generated files and given ones are read in processes of their own. What comes is compared with
another reader of the format. A row is "exactly" where all of the file is there, names what is
not, or has the line that refuses the file. Points that differ from those of the other reader, more
than one line, a dead process, or a command line that does not agree with Python are told, and end
the program with code 1 and without a page. MeshLab has readers of its own: its column says whether
our filter found the same points.
"""

from __future__ import annotations

import argparse
import contextlib
import html
import io
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import format_files
import format_oracles
import numpy as np
from numpy.typing import NDArray

from o3d_sofnn.cli import main as command_line
from o3d_sofnn.compare import isolated
from o3d_sofnn.files import point_files

SECONDS = 60.0
"""What a file may take."""
WRONG = "WRONG"
"""What begins the result of a file that should not be."""
HEAD = """\
# Files as users hold them

What becomes of {count} files: {exactly} are read exactly, {lost} with a loss that is named,
{refused} are refused in one line. None is read wrong, none ends the interpreter. Python and the
command line agree on every file. Points are compared with those of another reader of the format:
plyfile, laspy, pye57, trimesh, Open3D, or a few lines of plain code.

`demos/benchmarks/formats.py` makes this page, and {made} of the files, as programs export them or
as downloads and copies leave them; the others are collected. MeshLab reads files with readers of
its own: the last column says whether our filter found the same points there.
[Files](files.md) says what is read of each format.

| file | holds | result | MeshLab |
|---|---|---|---|"""


@dataclass(frozen=True)
class Row:
    """What became of a file."""

    name: str
    holds: str
    result: str
    meshlab: str = ""

    @property
    def kind(self) -> str:
        """Return "exactly", "lost", "refused" or "WRONG"."""
        if self.meshlab.startswith(WRONG):
            return WRONG
        first = self.result.split(":")[0]
        return first if first in ("exactly", "refused", WRONG) else "lost"

    def __str__(self) -> str:
        """Return a line of a table."""
        texts = (html.escape(each, quote=False) for each in (self.holds, self.result, self.meshlab))
        return f"| `{self.name}` | {' | '.join(each.replace('|', '/') for each in texts)} |"


def main() -> int:
    """Make, read, write the page; the exit code is 1 if something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("given", type=Path, nargs="*", help="files, or folders of files")
    parser.add_argument("--out", type=Path, help="the page to write (default: the screen)")
    args = parser.parse_args()
    given = [f for p in args.given for f in (sorted(p.iterdir()) if p.is_dir() else [p])]
    with tempfile.TemporaryDirectory() as folder:
        made = format_files.make(Path(folder))
        rows = [run(path) for path in [*made, *given]]
    wrong = [row for row in rows if row.kind == WRONG]
    if wrong:
        print("not written, as these should not be:", *wrong, sep="\n", file=sys.stderr)
        return 1
    kinds = Counter(row.kind for row in rows)
    counts = {kind: kinds[kind] for kind in ("exactly", "lost", "refused")}
    head = HEAD.format(count=len(rows), made=len(made), **counts)
    page = "\n".join([head, *(str(row) for row in sorted(rows, key=order)), ""])
    if args.out:
        args.out.write_text(page, encoding="utf-8")
    else:
        print(page)
    return 0


def order(row: Row) -> tuple[str, str]:
    """Return what rows are sorted by: ending, then name."""
    return Path(row.name).suffix.lower(), row.name


def run(path: Path) -> Row:
    """Read a file in all ways."""
    truth = isolated.call(format_oracles.points_of, path, timeout=SECONDS).value
    outcome = isolated.call(row_of, path, truth, timeout=SECONDS)
    if outcome.error is not None:
        return Row(path.name, "", f"{WRONG}: {outcome.error}")
    row: Row = outcome.value
    if row.kind not in ("exactly", "lost"):
        return row
    seen = isolated.call(meshlab_of, path, timeout=SECONDS)
    if seen.error is None:
        return replace(row, meshlab=seen.value)
    is_death = seen.error.startswith(("crashed", "stopped"))
    return replace(row, meshlab="ends with it" if is_death else f"{WRONG}: {seen.error}")


def row_of(path: Path, truth: NDArray[Any] | None) -> Row:
    """Read a file through Python and the command line, and compare with what another reader has."""
    try:
        file = point_files.read_points(path)
    except ValueError as error:
        return _refused(path, str(error))
    code, line, written = _by_command(path)
    if code == command_line.BAD_INPUT and len(file.points) < 4:
        return _refused(path, line)
    fault = None
    if code or written is None:
        fault = f"the command line ended with {code}: {line}"
    elif not _same(written.points, file.points):
        fault = "the output has other points"
    if truth is not None and not _same(file.points, truth):
        fault = f"{len(file.points)} points, another reader has other {len(truth)}"
    if fault:
        return Row(path.name, _holds(file), f"{WRONG}: {fault}")
    checked = "" if truth is not None else " (no other reader)"
    return Row(path.name, _holds(file), "; ".join(file.notes) or f"exactly{checked}")


def meshlab_of(path: Path) -> str:
    """Read a file with MeshLab, and say what our filter for normals made of it."""
    import meshlab_sofnn
    import pymeshlab

    meshlab_sofnn.register(plugin=False)
    meshes = pymeshlab.MeshSet(verbose=False)
    try:
        meshes.load_new_mesh(str(path))
    except pymeshlab.PyMeshLabException:
        return "does not read it"
    found = meshes.current_mesh().transformed_vertex_matrix()
    ours = point_files.read_points(path).points
    same = found.shape == ours.shape
    if not same or not np.allclose(found, ours, rtol=1e-6, atol=1e-6, equal_nan=True):
        return f"reads {len(found)} other points" if len(found) else "reads no points"
    if meshes.current_mesh().face_number():
        meshes.meshing_remove_all_faces()
    meshes.compute_normal_for_point_clouds_sofnn()
    lengths = np.linalg.norm(meshes.current_mesh().vertex_normal_matrix(), axis=1)
    finite = np.isfinite(ours).all(axis=1)
    return "the same points" if np.allclose(lengths[finite], 1.0) else f"{WRONG}: no normals"


def _refused(path: Path, message: str) -> Row:
    code, line, _ = _by_command(path)
    if code != command_line.BAD_INPUT or "\n" in line or not line:
        return Row(path.name, "", f"{WRONG}: the command line ended with {code}: {line}")
    short = message.replace(f"{path}: ", "").replace(str(path), path.name)
    return Row(path.name, "", f"refused: {short.removeprefix('refused: ')}")


def _by_command(path: Path) -> tuple[int, str, point_files.PointFile | None]:
    """Return the exit code, what was said of errors, and the output."""
    err = io.StringIO()
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stderr(err):
        target = Path(folder, "out.ply")
        code = command_line.main(["normals", str(path), str(target)])
        written = point_files.read_points(target) if target.exists() else None
    lines = [line for line in err.getvalue().splitlines() if "WARNING" not in line]
    prefix = "o3d-sofnn: error: "
    return code, "\n".join(line.removeprefix(prefix) for line in lines), written


def _holds(file: point_files.PointFile) -> str:
    parts = [f"{len(file.points)} points"]
    parts += ["normals"] * (file.normals is not None)
    parts += [name for name in ("colors",) if name in file.attributes]
    others = [name for name in file.attributes if name != "colors"]
    parts += others if len(others) < 5 else [f"{len(others)} attributes"]
    parts += ["viewpoint"] * (file.viewpoint is not None)
    parts += ["coordinate system"] * (file.crs is not None)
    return ", ".join(parts)


def _same(one: Any, other: Any) -> bool:
    """Return whether points are the same, but for the last digit of transformations."""
    return one.shape == other.shape and bool(
        np.allclose(one, other, rtol=1e-14, atol=1e-14, equal_nan=True)
    )


if __name__ == "__main__":
    sys.exit(main())
