"""The directive ``command-help``: the text that ``ospc COMMAND --help`` prints, for every command, as it is now."""

from __future__ import annotations

from typing import Any

import click
from docutils import nodes
from docutils.parsers.rst import Directive
from sphinx.application import Sphinx

from ospc.cli.main import cli

_WIDTH = 96


def _help_texts(command: click.Command, name: str, parent: click.Context | None = None) -> list[tuple[str, str]]:
    """Return name and help text of a command and all below it."""
    widths = {"max_content_width": _WIDTH, "terminal_width": _WIDTH}
    context = click.Context(command, info_name=name, parent=parent, **command.context_settings | widths)
    texts = [(context.command_path, command.get_help(context))]
    if isinstance(command, click.Group):
        for below in command.list_commands(context):
            inner = command.get_command(context, below)
            if inner is not None:
                texts += _help_texts(inner, below, context)
    return texts


class CommandHelp(Directive):
    """One section for each command, with its help text in it."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        sections: list[nodes.Node] = []
        for name, text in _help_texts(cli, "ospc"):
            section = nodes.section(ids=[nodes.make_id(name)], names=[nodes.fully_normalize_name(name)])
            section += nodes.title(text=name)
            section += nodes.literal_block(text, text, language="text")
            sections.append(section)
        return sections


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directive."""
    app.add_directive("command-help", CommandHelp)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
