"""The only way to standard output and standard error: what a terminal would interpret is escaped.

Names of folders, topics, cameras and texts in files come from outside, and terminals obey escape sequences in them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import click

from ospc.errors import escaped

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.segment import Segment


class Styled(str):
    """A text that may hold escape sequences; make one with :func:`styled`."""

    __slots__ = ()


def styled(text: str, **style: Any) -> Styled:
    """Return a text in a style of :func:`click.style`."""
    return Styled(click.style(escaped(text), **style))


def say(*parts: str, err: bool = False) -> None:
    """Print one line, on standard error if ``err``: :class:`Styled` parts as they are, any other text escaped."""
    click.echo("".join(part if isinstance(part, Styled) else escaped(part) for part in parts), err=err)


def console(**options: Any) -> Console:
    """Return a console of rich, for tables and progress, that escapes as :func:`say` does."""
    from rich.console import Console
    from rich.segment import Segment

    class SafeConsole(Console):
        def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
            for segment in super().render(renderable, options):
                yield segment if segment.control else Segment(escaped_lines(segment.text), segment.style)

    return SafeConsole(highlight=False, **options)


def escaped_lines(text: str) -> str:
    """Return a text of several lines with everything else escaped that a terminal would interpret."""
    return "\n".join(escaped(line.expandtabs(4)) for line in text.split("\n"))
