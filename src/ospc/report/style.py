"""The style of all pictures, and the output of figures."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from html import escape
from pathlib import Path
from threading import RLock
from typing import Any

from ospc.errors import FormatError
from ospc.formats.files import write_bytes

BLUE, ORANGE, GREEN, GREY, BLACK = "#0072B2", "#D55E00", "#009E73", "#999999", "#000000"
"""Colours that colour-blind readers can distinguish: Okabe and Ito, 2008, "Color universal design"."""
DPI = 140
"""Pixels per inch of PNG pictures: sharp when a picture fills the width of a page."""

_RULES: Any = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titley": 1.0,  # fixed: automatic placement takes a sixth of the time
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.fontsize": 8.0,
    "legend.framealpha": 0.8,
    "svg.fonttype": "none",  # text stays text: smaller files, and readers can search it
    "svg.hashsalt": "ospc",  # identifiers depend only on the content, so equal charts give equal bytes
}
_UNDATED = dict.fromkeys(("Date", "Creator", "Format", "Type"))
_ONE_AT_A_TIME = RLock()


def new_figure(width_in: float, height_in: float, margins_in: Mapping[str, float] | None = None) -> Any:
    """Return an empty matplotlib figure that needs no display and no global state.

    ``margins_in`` are the left, right, top and bottom margins of all axes; with None, matplotlib determines them,
    which doubles the time.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout=None if margins_in else "constrained")
    if margins_in:
        figure.subplots_adjust(
            left=margins_in["left"] / width_in,
            right=1 - margins_in["right"] / width_in,
            top=1 - margins_in["top"] / height_in,
            bottom=margins_in["bottom"] / height_in,
        )
    return figure


def load() -> None:
    """Import the drawing modules of matplotlib in advance."""
    import matplotlib.axes
    import matplotlib.backends.backend_agg
    import matplotlib.backends.backend_svg
    import matplotlib.figure  # noqa: F401


@contextmanager
def rules() -> Iterator[None]:
    """Apply the style to all figures drawn within; only one thread draws at a time, as matplotlib requires."""
    import matplotlib as mpl

    with _ONE_AT_A_TIME, mpl.rc_context(_RULES):
        yield


def save(figure: Any, path: Path) -> Path:
    """Write a figure in the format given by the suffix, completely or not at all, and return the path.

    Raises
    ------
    FormatError
        If the file cannot be written, or matplotlib does not support the suffix.
    """
    try:
        picture = as_bytes(figure, path.suffix.removeprefix(".").lower() or "png")
    except ValueError:
        raise FormatError(f"{path}: unknown picture format; use .png, .svg or .pdf") from None
    return write_bytes(path, picture)


def as_bytes(figure: Any, kind: str) -> bytes:
    """Return a figure in a format such as "png"; ValueError if matplotlib does not support it."""
    fast = {"pil_kwargs": {"compress_level": 2}} if kind == "png" else {}
    picture = io.BytesIO()
    figure.savefig(picture, format=kind, dpi=DPI, **fast)
    return picture.getvalue()


def as_svg(figure: Any, title: str) -> str:
    """Return a figure as an SVG element for HTML, labelled for screen readers; equal figures give equal text."""
    drawn = io.StringIO()
    figure.savefig(drawn, format="svg", metadata=_UNDATED)
    # Groups have the same identifiers in every figure, but identifiers must be unique within a page.
    content = re.sub(r'<g id="[^"]*">', "<g>", drawn.getvalue())
    size = re.search(r'viewBox="[^"]*"', content)
    inner = content[content.index("<defs>") :]
    assert size is not None
    return f'<svg class="chart" {size.group()} role="img" aria-label="{escape(title)}">{inner.rstrip()}'


def printable(text: str) -> str:
    """Return a text on one line, with "?" for every character that the font of the pictures lacks."""
    from matplotlib.font_manager import findfont, get_font

    font = get_font(findfont("DejaVu Sans"))
    return "".join(c if font.get_char_index(ord(c)) else "?" for c in " ".join(text.split()))
