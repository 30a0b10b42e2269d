"""How all pictures look: colours that the colour-blind tell apart, sizes, and how they are saved."""

from __future__ import annotations

import io
from contextlib import suppress
from pathlib import Path
from typing import Any

from ospc.atomic import write_atomically
from ospc.errors import FormatError, MissingExtraError

BLUE, ORANGE, GREEN, GREY, BLACK = "#0072B2", "#D55E00", "#009E73", "#999999", "#000000"
"""Vermilion, blue and bluish green of Okabe and Ito, 2008, "Color universal design"."""

DPI = 130
_RULES: Any = {
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.fontsize": 8.5,
    "legend.framealpha": 0.9,
}


def new_figure(width_in: float, height_in: float) -> Any:
    """Return an empty matplotlib figure that needs no display and no global state.

    Raises
    ------
    MissingExtraError
        Without matplotlib.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise MissingExtraError("drawing pictures", "plots") from None
    return Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")


def load() -> None:
    """Load what draws, so that it need not be waited for later; nothing happens where it is not installed."""
    with suppress(ImportError):
        import matplotlib.axes
        import matplotlib.backends.backend_agg
        import matplotlib.figure  # noqa: F401


def rules() -> Any:
    """Return the context within which figures get this project's look."""
    import matplotlib as mpl

    return mpl.rc_context(_RULES)


def save(figure: Any, path: Path) -> Path:
    """Write a figure as PNG, whole or not at all, and return the path.

    Raises
    ------
    FormatError
        If the file cannot be written.
    """
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=DPI, pil_kwargs={"compress_level": 2})
    try:
        return write_atomically(path, picture.getvalue())
    except OSError as error:
        raise FormatError(f"{path}: the picture cannot be written ({error.strerror})") from None
