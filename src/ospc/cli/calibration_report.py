"""What commands say about a calibration: notes, verdicts, errors against a truth."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from ospc.cli.calibration_run import Outcome
    from ospc.evaluation.comparison import Comparison
    from ospc.output import OutputFolder, Written
    from ospc.photometry.calibration import Calibration

_STYLES = {"identifiable": "green", "marginal": "yellow", "not identifiable": "red"}
_FIGURES = {
    "response_rmse": "response, RMSE of g",
    "response_shape_rmse": "response shape, RMSE after the best scale",
    "log_ratio_error": "response, log-ratio error κ",
    "vignette_rmse": "vignette, RMSE of the radial profile",
    "vignette_pixel_rmse": "vignette, RMSE over all pixels",
}


def say_notes(notes: Sequence[str]) -> None:
    """Print notes on standard error."""
    for note in notes:
        click.echo(f"note: {note}", err=True)


def say_skipped(outcome: Outcome) -> None:
    """Print how many frames were skipped, and why the first few were, on standard error."""
    count = outcome.calibration.counts.get("skipped", 0)
    if not count:
        return
    more = "; …" if count > len(outcome.skipped) else ""
    click.echo(
        f"warning: {count} of {outcome.calibration.counts['frames']} frames skipped: "
        f"{'; '.join(outcome.skipped)}{more}",
        err=True,
    )


def say_result(outcome: Outcome, total_frames: int, folder: OutputFolder, written: Written) -> None:
    """Print the verdicts and where the files are."""
    calibration = outcome.calibration
    say_verdicts(calibration)
    counts = calibration.counts
    seen = f"{counts['frames']} of {total_frames} frames" if calibration.partial else f"{counts['frames']} frames"
    click.echo(f"from {seen}, {counts.get('pairs', 0)} pairs, {counts.get('samples', 0)} samples")
    if outcome.interrupted:
        click.echo("partial: the run was interrupted; more frames would tell more")
    elif calibration.partial:
        click.echo("partial: the run failed before its end")
    names = [str(file.relative_to(folder.path)) for file in written.files]
    click.echo(f"written to {folder.path}: {', '.join(names)}")


def say_verdicts(calibration: Calibration) -> None:
    """Print what is known, why, and what to record instead of the rest."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(show_edge=False, pad_edge=False, header_style="bold")
    for heading in ("", "state", "why, and what to record instead"):
        table.add_column(heading, overflow="fold")
    for name, verdict in calibration.verdicts.items():
        explanation = Text(verdict.reason)
        if verdict.remedy:
            explanation.append(f"\n→ {verdict.remedy}")
        table.add_row(name, Text(verdict.state, style=_STYLES[verdict.state]), explanation)
    console = Console(highlight=False, width=None if sys.stdout.isatty() else 110)
    console.print()
    console.print(table)
    console.print()


def say_errors(comparison: Comparison | None, calibration: Calibration, truth: str) -> None:
    """Print how far the calibration is from a truth."""
    if comparison is None:
        click.echo(f"\nnothing to compare with {truth}: the estimate knows none of what it holds")
        return
    click.echo(f"\nagainst {truth} (nothing aligned):")
    for name, label in _FIGURES.items():
        value = getattr(comparison, name)
        if value is not None:
            click.echo(f"  {label:42} {value:.4f}")
    if comparison.response_coverage is not None:
        share = comparison.response_coverage
        click.echo(f"  {'response within ±1σ / ±2σ':42} {share.within_1_sigma:.0%} / {share.within_2_sigma:.0%}")
    spread, bias = ratio_figures(calibration) or (None, None)
    if spread is not None:
        click.echo(f"  {'exposure ratios, median |Δ ln k| (bias)':42} {spread:.4f} ({bias:+.4f})")


def ratio_figures(calibration: Calibration) -> tuple[float, float] | None:
    """Return the misfit of the exposure ratios to the metadata and their bias; None without pairs."""
    ratios = calibration.exposure_ratios
    return (ratios.misfit, ratios.bias) if ratios.metadata.size else None


def as_json(
    outcome: Outcome, folder: OutputFolder, written: Written, comparison: Comparison | None
) -> dict[str, Any]:
    """Return all that is said as JSON-compatible values."""
    calibration = outcome.calibration
    content: dict[str, Any] = {
        "out": str(folder.path),
        "partial": calibration.partial,
        "interrupted": outcome.interrupted,
        "error": outcome.failure or None,
        "verdicts": {name: vars(verdict) for name, verdict in calibration.verdicts.items()},
        "converged": calibration.converged,
        "exponent_sigma": calibration.exponent_sigma,
        "counts": calibration.counts,
        "skipped": list(outcome.skipped),
        "advice": list(calibration.advice),
        "exposure_lag_frames": calibration.source.get("exposure_lag_frames"),
        "exposure_lag_corrected_frames": calibration.source.get("exposure_lag_corrected_frames", 0),
        "warnings": list(calibration.warnings),
        "files": [str(file) for file in written.files],
    }
    ratios = ratio_figures(calibration)
    if ratios is not None:
        content["exposure_ratios"] = {"median_abs_log_error": ratios[0], "bias": ratios[1]}
    if comparison is not None:
        content["errors"] = {name: getattr(comparison, name) for name in _FIGURES}
        if comparison.response_coverage is not None:
            content["errors"]["response_coverage"] = comparison.response_coverage._asdict()
    return content
