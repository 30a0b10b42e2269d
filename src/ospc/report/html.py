"""HTML generation; every text is escaped unless it is marked as HTML."""

from __future__ import annotations

from html import escape
from importlib.resources import files

from ospc.errors import escaped

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
"""Content security policy of a page: no external resources and no scripts."""
_VOID = ("img", "meta", "br")
"""Elements without content and end tag."""


class Html(str):
    """A piece of HTML that is not escaped."""

    __slots__ = ()


def tag(name: str, /, *content: str, **attributes: str) -> Html:
    """Return an element with the given content, escaped unless it is :class:`Html`.

    A trailing underscore of an attribute's name is dropped (``class_``), other underscores become hyphens; attributes
    with an empty value are left out.
    """
    given = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{_safe(value)}"' for key, value in attributes.items() if value
    )
    if name in _VOID:
        return Html(f"<{name}{given}>")
    return Html(f"<{name}{given}>{join(*content)}</{name}>")


def join(*parts: str) -> Html:
    """Return the concatenated parts, escaped unless they are :class:`Html`."""
    return Html("".join(part if isinstance(part, Html) else _safe(part) for part in parts))


def _safe(text: str) -> str:
    return escape("\n".join(map(escaped, text.split("\n"))))


def document(title: str, *content: str) -> str:
    """Return a complete page that needs neither network nor scripts; the content is as for :func:`tag`."""
    style = files("ospc.report").joinpath("report.css").read_text(encoding="utf-8")
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("title", title),
        tag("style", Html(style)),
    )
    return f"<!DOCTYPE html>\n{tag('html', head, tag('body', tag('main', *content)), lang='en')}\n"
