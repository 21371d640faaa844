"""Rules of a network in a human-readable text file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from o3d_sofnn.sofnn.neurons import Neurons

if TYPE_CHECKING:
    from o3d_sofnn.sofnn.estimator import SOFNN

DIGITS = 6
"""Digits kept of every number."""


def write_rules(network: SOFNN, file: Path, about: dict[str, object]) -> None:
    """Write the rules of a network with one output, in words and in numbers.

    Parameters
    ----------
    network : SOFNN
        Fitted with named inputs.
    file : Path
        JSON file to write; it is overwritten.
    about : dict
        Description of the rules and of how they were made.
    """
    names = [str(name) for name in network.feature_names_in_]
    slopes = network.slopes_
    rules = [
        {
            "if": {
                name: {"about": _short(center), "width": _short(width)}
                for name, center, width in zip(names, centers, widths, strict=True)
            },
            "then": {
                "value": _short(network.theta_[0, row]),
                "slopes": {}
                if slopes is None
                else {name: _short(s) for name, s in zip(names, slopes[0, row], strict=True)},
            },
        }
        for row, (centers, widths) in enumerate(zip(network.centers_, network.widths_, strict=True))
    ]
    text = {**about, "inputs": names, "in words": network.rules_, "rules": rules}
    file.write_text(json.dumps(text, indent=1) + "\n", encoding="utf-8")


def read_rules(file: Path, inputs: Sequence[str]) -> Neurons:
    """Read the rules of a network that :func:`write_rules` wrote.

    Parameters
    ----------
    file : Path
        JSON.
    inputs : sequence of str
        Names that the inputs must have, in this order.

    Returns
    -------
    Neurons
        Rules for :meth:`SOFNN.restore`.

    Raises
    ------
    ValueError
        The file is not a rule file, or has other inputs.
    """
    try:
        text = json.loads(file.read_text(encoding="utf-8"))
        names, rules = text["inputs"], text["rules"]
        centers = np.array([[rule["if"][n]["about"] for n in names] for rule in rules], float)
        widths = np.array([[rule["if"][n]["width"] for n in names] for rule in rules], float)
        value = np.array([rule["then"]["value"] for rule in rules], float)
        linear = bool(rules[0]["then"]["slopes"])
        slopes = [[rule["then"]["slopes"][n] for n in names] for rule in rules] if linear else []
    except (KeyError, TypeError, IndexError, json.JSONDecodeError) as problem:
        raise ValueError(f"{file}: expected a file of rules, got {problem!r}") from None
    if list(names) != list(inputs):
        raise ValueError(f"{file}: expected rules for {list(inputs)}, got {names}")
    terms = [value, *(np.array(slopes) * widths).T] if linear else [value]
    return Neurons(centers, widths, np.stack(terms)[:, :, None])


def _short(number: float) -> float:
    return float(f"{number:.{DIGITS}g}")
