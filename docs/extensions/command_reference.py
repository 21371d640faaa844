"""The directive ``command-reference``: the options of ``o3d-sofnn`` as its parser has them."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive

from o3d_sofnn.cli.parser import make_parser


class CommandReference(Directive):
    """Write a section for each command: usage, text, arguments, options, epilogue."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        parser = make_parser()
        return [_section(command) for command in _commands(parser)]


def setup(app: Any) -> dict[str, bool]:
    """Register the directive with Sphinx."""
    app.add_directive("command-reference", CommandReference)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _commands(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            yield from action.choices.values()


def _section(parser: argparse.ArgumentParser) -> nodes.section:
    section = nodes.section(ids=[nodes.make_id(parser.prog)])
    section += nodes.title(text=parser.prog)
    usage = " ".join(parser.format_usage().removeprefix("usage: ").split())
    section += _wrapped(usage)
    section += nodes.paragraph(text=" ".join((parser.description or "").split()))
    options = nodes.definition_list()
    for action in parser._actions:
        if not isinstance(action, argparse._HelpAction):
            options += _option(parser, action)
    section += options
    if parser.epilog:
        section += _wrapped(parser.epilog.strip())
    return section


def _wrapped(text: str) -> nodes.container:
    return nodes.container("", nodes.literal_block(text=text, language="text"), classes=["wrapped"])


def _option(parser: argparse.ArgumentParser, action: argparse.Action) -> nodes.definition_list_item:
    formatter = parser._get_formatter()
    shown = formatter._format_action_invocation(action)
    if action.choices is not None and action.option_strings:
        shown = f"{action.option_strings[0]} {'|'.join(map(str, action.choices))}"
    text = formatter._expand_help(action) if action.help else ""
    return nodes.definition_list_item(
        "",
        nodes.term("", "", nodes.literal(text=shown)),
        nodes.definition("", nodes.paragraph(text=text)),
    )
