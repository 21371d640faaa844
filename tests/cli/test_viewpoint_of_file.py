"""A scanner's place in a file is used unless something else is said of the sides."""

from __future__ import annotations

import json

import numpy as np
import pytest
from shapes import plane_patch

from o3d_sofnn.cli.main import main
from o3d_sofnn.files import point_files


@pytest.fixture
def scan(tmp_path):
    """A level sheet that was seen from below, as its header says."""
    rows = plane_patch(600).points
    header = [
        "VERSION .7",
        "FIELDS x y z",
        "SIZE 4 4 4",
        "TYPE F F F",
        "COUNT 1 1 1",
        f"WIDTH {len(rows)}",
        "HEIGHT 1",
        "VIEWPOINT 0.1 0.2 -3 1 0 0 0",
        f"POINTS {len(rows)}",
        "DATA ascii",
    ]
    path = tmp_path / "scan.pcd"
    path.write_text("\n".join([*header, *(" ".join(map(str, row)) for row in rows)]) + "\n")
    return path


@pytest.mark.parametrize(
    ("options", "used", "up"),
    [
        ((), True, False),
        (("--no-viewpoint",), False, True),
        (("--viewpoint", "0", "0", "5"), False, True),
        (("--towards", "0", "0", "1"), False, True),
    ],
)
def test_the_place_in_the_file(scan, tmp_path, options, used, up):
    out, report = tmp_path / "out.ply", tmp_path / "report.json"
    arguments = ["normals", str(scan), str(out), "--json", str(report), *options]
    assert main(arguments) == 0
    assert json.loads(report.read_text())["viewpoint_of_file"] is used
    normals = point_files.read_points(out).normals
    assert ((normals[:, 2] > 0.0) == up).all()
    assert np.isfinite(normals).all()
