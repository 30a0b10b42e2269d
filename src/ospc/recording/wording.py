"""How messages quote text from a file."""

from __future__ import annotations

from collections.abc import Sequence

_SHOWN_CHARACTERS = 40
"""Characters of a quotation before it is cut."""

_SHOWN_ITEMS = 3
"""Items of a list that a message names."""


def quoted(text: str) -> str:
    """Return the text in quotes, shortened, on one line, with control characters escaped."""
    if len(text) > _SHOWN_CHARACTERS:
        text = text[:_SHOWN_CHARACTERS] + "…"
    return f"'{escaped(text)}'"


def escaped(text: str) -> str:
    """Return the text on one line, with everything escaped that a terminal would interpret."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


def listed(items: Sequence[object]) -> str:
    """Return the first few of many as 'a, b, c and 7 more'."""
    shown = ", ".join(escaped(str(item)) for item in items[:_SHOWN_ITEMS])
    rest = len(items) - _SHOWN_ITEMS
    return f"{shown} and {rest} more" if rest > 0 else shown
