"""What docstrings say about defaults is what signatures do."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re

import pytest

import o3d_sofnn

PARAMETER = re.compile(r"^ {0,8}(\w+) : (.*)$", re.MULTILINE)


def value(text):
    try:
        return ast.literal_eval(text.strip("`"))
    except (ValueError, SyntaxError):
        return text.strip("`'\"")


def public_callables():
    for info in pkgutil.walk_packages(o3d_sofnn.__path__, "o3d_sofnn."):
        if info.name.rpartition(".")[2].startswith("_"):
            continue
        module = importlib.import_module(info.name)
        for name, thing in vars(module).items():
            if name.startswith("_") or getattr(thing, "__module__", None) != info.name:
                continue
            if inspect.isfunction(thing) or inspect.isclass(thing):
                yield pytest.param(thing, id=f"{info.name}.{name}")


@pytest.mark.parametrize("thing", list(public_callables()))
def test_documented_defaults_are_the_real_ones(thing):
    assert thing.__doc__, "no docstring"
    documented, _, _ = inspect.cleandoc(thing.__doc__).partition("\nReturns\n")
    try:
        parameters = inspect.signature(thing).parameters
    except ValueError:
        pytest.skip("no signature")
    for name, text in PARAMETER.findall(documented):
        if name not in parameters:
            continue
        default = parameters[name].default
        said = re.search(r"default (.+)$", text)
        if said:
            assert value(said.group(1)) == default, name
        elif text.endswith("optional"):
            assert default is None, name
