"""A picture of every recording's errors, all methods side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ospc.benchmark.summary import METRICS, CaseResult, methods_of
from ospc.errors import FormatError

_PANELS = ("response_shape_rmse", "log_ratio_error", "vignette_rmse", "ratio_median_abs")
_MARKERS = "osD^vP*X"
_ROW_INCHES = 0.21


def draw_errors(results: Sequence[CaseResult], path: str | Path) -> Path:
    """Draw a panel for each of four errors, a line for each recording and a mark for each method.

    Parameters
    ----------
    results
        At least one with rows.
    path
        Where to; the suffix says the kind of picture.

    Returns
    -------
    Path
        The picture's path.

    Raises
    ------
    FormatError
        If the picture cannot be written.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    labels = {metric.figure: metric.label for metric in METRICS}
    figure = Figure(figsize=(15, 1.6 + _ROW_INCHES * len(results)), layout="constrained")
    panels = figure.subplots(1, len(_PANELS), sharey=True)
    for axes, name in zip(panels, _PANELS, strict=True):
        for number, method in enumerate(methods_of(results)):
            points = [(v, i) for i, r in enumerate(results) if (v := r.value(method, name)) is not None and v > 0]
            if points:
                x, y = zip(*points, strict=True)
                axes.plot(x, y, _MARKERS[number % len(_MARKERS)], ms=4.5, alpha=0.8, label=method, color=f"C{number}")
        axes.set(title=labels[name], xscale="log")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(alpha=0.3, which="both", lw=0.5)
    panels[0].set_yticks(range(len(results)), [r.case.name for r in results], fontsize=7)
    panels[0].set_ylim(len(results) - 0.5, -0.5)
    handles = {label: h for axes in panels for h, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=max(1, len(handles)))
    try:
        figure.savefig(path, dpi=110)
    except (OSError, ValueError) as error:
        raise FormatError(f"{path}: the picture cannot be written ({error})") from None
    return Path(path)
