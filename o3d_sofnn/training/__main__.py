"""Learn the off-line rules and write them: ``python -m o3d_sofnn.training``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from o3d_sofnn.rules.trust import INPUTS, SHIPPED
from o3d_sofnn.sofnn.rule_file import write_rules

ABOUT: dict[str, object] = {
    "about": "how wrong the normal of a rule is at a place: y is log(squared angle)",
    "made by": "python -m o3d_sofnn.training, from generated shapes alone",
}


def main() -> None:
    """Learn, print how much the rules gain on the shapes they were learned from, write them."""
    parser = argparse.ArgumentParser(prog="o3d_sofnn.training", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=SHIPPED, help="file to write")
    parser.add_argument("--rounds", type=int, default=5, help="clouds of each shape")
    parser.add_argument("--trials", type=int, default=16, help="networks to fit; the best is kept")
    options = parser.parse_args()
    from o3d_sofnn.training.learning import clouds, learn  # after --help

    network, gain = learn(list(clouds(options.rounds)), options.trials)
    network.feature_names_in_ = np.array(INPUTS, dtype=object)
    write_rules(network, options.out, {**ABOUT, "error over that without": round(gain, 4)})
    sys.stdout.write("\n".join([*network.rules_, f"error over that without: {gain:.3f}", ""]))


if __name__ == "__main__":
    main()
