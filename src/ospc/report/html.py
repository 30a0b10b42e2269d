"""HTML in which every text is escaped unless it is marked as HTML already."""

from __future__ import annotations

from html import escape

_VOID = ("img", "meta", "br")
"""Elements that have no content and no end tag."""


class Html(str):
    """A piece of HTML, embedded as it is."""

    __slots__ = ()


def tag(name: str, /, *content: str, **attributes: str) -> Html:
    """Return an element.

    Parameters
    ----------
    name
        Its name.
    content
        What is in it: :class:`Html` as it is, any other text escaped.
    attributes
        Their values, escaped; a trailing underscore of a name is dropped (``class_``), other underscores become
        hyphens, and attributes without a value are left out.
    """
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"' for key, value in attributes.items() if value
    )
    if name in _VOID:
        return Html(f"<{name}{given}>")
    return Html(f"<{name}{given}>{join(*content)}</{name}>")


def join(*parts: str) -> Html:
    """Return pieces one after another: :class:`Html` as it is, any other text escaped."""
    return Html("".join(part if isinstance(part, Html) else escape(part) for part in parts))
