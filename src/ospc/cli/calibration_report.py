"""What commands say about a calibration they have written: verdicts, files, errors against a truth."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from ospc.cli.terminal import console, say
from ospc.errors import OspcError

if TYPE_CHECKING:
    from ospc.evaluation.comparison import Comparison
    from ospc.formats.opening import Photometry
    from ospc.output import OutputFolder, Written
    from ospc.photometry.calibration import Calibration, Verdict

_STYLES = {"identifiable": "green", "marginal": "yellow", "not identifiable": "red"}
_WIDTH_WHEN_PIPED = 110
"""Characters per line of a table that does not go to a terminal."""

ERRORS = {
    "response_rmse": "response, RMSE of g",
    "response_shape_rmse": "response shape, RMSE after the best scale",
    "log_ratio_error": "response, log-ratio error κ",
    "vignette_rmse": "vignette, RMSE of the radial profile",
    "vignette_pixel_rmse": "vignette, RMSE over all pixels",
}
"""The metrics of a comparison with a truth, and what to call them."""


def print_json(content: Any) -> None:
    """Print one JSON document on standard output; numbers that are not finite become null."""
    for line in json.dumps(_finite(content), indent=1, allow_nan=False).split("\n"):
        say(line.replace("\x7f", "\\u007f"))  # the only control character that JSON leaves as it is


def concluded(content: dict[str, Any], *, as_json: bool) -> int:
    """Print a result as JSON if that is asked for, and return its exit code; OspcError if the run failed."""
    if as_json:
        print_json(content)
    if content["error"]:
        raise OspcError(content["error"])
    return int(content["exit_code"])


def _finite(content: Any) -> Any:
    if isinstance(content, dict):
        return {name: _finite(value) for name, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def say_notes(notes: Iterable[str], label: str = "note") -> None:
    """Print notes on standard error, one a line."""
    for note in notes:
        say(f"{label}: {note}", err=True)


def say_verdicts(verdicts: Mapping[str, Verdict]) -> None:
    """Print what is known, why, and what to record instead of the rest."""
    from rich.table import Table
    from rich.text import Text

    table = Table(show_edge=False, pad_edge=False, header_style="bold")
    for heading in ("", "state", "why, and what to record instead"):
        table.add_column(heading, overflow="fold")
    for name, verdict in verdicts.items():
        remedy = f"\n→ {verdict.remedy}" if verdict.remedy else ""
        table.add_row(
            Text(name), Text(verdict.state, style=_STYLES[verdict.state]), Text(f"{verdict.reason}{remedy}")
        )
    say()
    console(width=None if sys.stdout.isatty() else _WIDTH_WHEN_PIPED).print(table)
    say()


def say_result(
    calibration: Calibration, folder: OutputFolder, written: Written, truth: Photometry | None, basis: Iterable[str]
) -> None:
    """Print the verdicts, what they rest on, where the files are, and how far the result is from a truth."""
    say_verdicts(calibration.verdicts)
    for line in basis:
        say(line)
    say(f"written to {folder.path}: {', '.join(str(f.relative_to(folder.path)) for f in written.files)}")
    say_notes(written.notes)
    if truth is None:
        return
    comparison = _compared(calibration, truth)
    if comparison is None:
        say()
        say(f"nothing to compare with {truth.name}: the estimate knows none of what it holds")
        return
    say()
    say(f"against {truth.name} (nothing aligned):")
    rows = error_rows(comparison)
    ratios = calibration.exposure_ratios
    if ratios.metadata.size:
        rows["exposure ratios, median |Δ ln k| (bias)"] = f"{ratios.misfit:.4f} ({ratios.bias:+.4f})"
    for label, figure in rows.items():
        say(f"  {label:42} {figure}")


def error_rows(comparison: Comparison) -> dict[str, str]:
    """Return the figures of a comparison that are known, as text, by what to call them."""
    figures = {label: getattr(comparison, name) for name, label in ERRORS.items()}
    rows = {label: f"{figure:.4f}" for label, figure in figures.items() if figure is not None}
    share = comparison.response_coverage
    if share is not None:
        rows["response within ±1σ / ±2σ"] = f"{share.within_1_sigma:.0%} / {share.within_2_sigma:.0%}"
    return rows


def errors_as_dict(comparison: Comparison) -> dict[str, Any]:
    """Return the figures of a comparison as JSON-compatible values."""
    figures: dict[str, Any] = {name: getattr(comparison, name) for name in ERRORS}
    if comparison.response_coverage is not None:
        figures["response_coverage"] = comparison.response_coverage._asdict()
    return figures


def result_as_dict(
    calibration: Calibration, folder: OutputFolder, written: Written, truth: Photometry | None
) -> dict[str, Any]:
    """Return what :func:`say_result` prints, and more, as JSON-compatible values."""
    content: dict[str, Any] = {
        "out": str(folder.path),
        "partial": calibration.partial,
        "verdicts": {name: vars(verdict) for name, verdict in calibration.verdicts.items()},
        "converged": calibration.converged,
        "exponent_sigma": calibration.exponent_sigma,
        "counts": calibration.counts,
        "advice": list(calibration.advice),
        "warnings": list(calibration.warnings),
        "files": [str(file) for file in written.files],
    }
    ratios = calibration.exposure_ratios
    if ratios.metadata.size:
        content["exposure_ratios"] = {"median_abs_log_error": ratios.misfit, "bias": ratios.bias}
    comparison = None if truth is None else _compared(calibration, truth)
    if comparison is not None:
        content["errors"] = errors_as_dict(comparison)
    return content


def _compared(calibration: Calibration, truth: Photometry) -> Comparison | None:
    """Return the errors against a truth; None where the two have nothing in common."""
    from ospc.evaluation.comparison import compare
    from ospc.formats.opening import Photometry

    estimate = Photometry("estimate", calibration.response, calibration.vignette, calibration)
    for part in ("response", "vignette"):
        if getattr(estimate, part) is not None and getattr(truth, part) is not None:
            return compare(estimate, truth)
    return None
