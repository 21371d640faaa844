"""Compare with Open3D's and MeshLab's reconstructions: ``o3d-sofnn compare`` on shapes at hand.

Without arguments the inputs come from the pymeshlab wheel: two scans, and two closed models from
which points are drawn. Everything else is as in ``o3d-sofnn compare --help``.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from pathlib import Path

import demo
import inputs

from o3d_sofnn.cli import comparison
from o3d_sofnn.compare.cases import Model, Source
from o3d_sofnn.progress import make_progress

MODELS = ("bunny", "cow")


def main() -> int:
    """Compare; return 0 if this package succeeded on every cloud, 1 if not, 130 after Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("input", nargs="*", type=Path, metavar="IN", help="scans, closed meshes")
    comparison.add_options(parser, demo.HERE / "output" / "compare")
    args = parser.parse_args()
    mode = "bar" if sys.stderr.isatty() else "plain"
    with contextlib.closing(make_progress(mode)) as progress:
        try:
            return comparison.run(args, progress, _inputs(args.quick))
        except KeyboardInterrupt:
            return 130
        except ValueError as error:
            parser.error(str(error))


def _inputs(quick: bool) -> list[Source]:
    """Return the inputs that are compared without arguments."""
    scans = [Source("chameleon", lambda: inputs.chameleon().points, inputs.CHAMELEON_VIEW)]
    if not quick:
        scans.append(Source("face", lambda: inputs.face().points, inputs.FACE_VIEW))
    names = MODELS[:1] if quick else MODELS
    return scans + [
        Source(name, lambda name=name: _model(name), inputs.MODELS[name][1]) for name in names
    ]


def _model(name: str) -> Model:
    vertices, triangles, _ = inputs.read_model(inputs.MODELS[name][0])
    return Model(vertices, triangles)


if __name__ == "__main__":
    sys.exit(main())
