"""``ospc check``: what a recording can tell of its camera, and what is wrong with it."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ospc.cli.exposure_options import correct_lag_option
from ospc.cli.progress import progress_bar
from ospc.cli.reading import Reading, reading_options, say_topics

if TYPE_CHECKING:
    from ospc.diagnosis import RecordingReport
    from ospc.exposures.findings import LagChoice

_COLOURS = {"identifiable": "green", "marginal": "yellow", "not identifiable": "red"}


@click.command("check")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print everything as JSON.")
@click.option("--plot", type=click.Path(path_type=Path), help="Draw the result into this picture.")
@click.option(
    "--frames",
    type=click.IntRange(min=2),
    help="Take only so many frames from the beginning.",
)
@correct_lag_option
@reading_options
@click.option("--list-topics", is_flag=True, help="Say what topics the bag at PATH has, and do nothing else.")
def command(
    path: Path,
    *,
    as_json: bool,
    plot: Path | None,
    frames: int | None,
    correct_lag: LagChoice,
    list_topics: bool,
    **reading: Any,
) -> None:
    """Say what a calibration of the recording at PATH finds, without writing one.

    Takes the whole recording, or its beginning (--frames). Says whether response, vignette and exposures are
    identifiable, and what to record instead; whether each exposure belongs to its frame; and what in the recording
    would spoil a calibration. The verdicts are those of 'ospc calibrate' on the same frames.
    """
    from ospc.diagnosis import check_recording

    if list_topics:
        say_topics(path)
        return
    recording = Reading.taken_from(reading).open(path)
    total = min(frames or len(recording), len(recording))
    with progress_bar("checking", total, visible=sys.stderr.isatty()) as progress:
        report = check_recording(recording, frames=frames, correct_lag=correct_lag, progress=progress)
    if plot is not None:
        from ospc.report.check import plot_report

        plot_report(report, plot)
    if as_json:
        import json

        click.echo(json.dumps(report.as_dict(), indent=1, allow_nan=False, ensure_ascii=False))
        return
    _print_text(path, report)
    if plot is not None:
        click.echo(f"plot: {plot}")


def _print_text(path: Path, report: RecordingReport) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(highlight=False)
    width, height = report.size
    shown = f"{path}: {report.frames} frames {width}×{height}, {report.processed} of them processed"
    console.print(shown, markup=False, soft_wrap=True)
    verdicts = Table(show_header=False)
    for name, verdict in report.verdicts.items():
        state = Text(verdict.state, style=_COLOURS[verdict.state])
        advice = f"\n→ {verdict.remedy}" if verdict.remedy else ""
        verdicts.add_row(name, state, Text(f"{verdict.reason}{advice}"))
    console.print(verdicts)
    figures = Table(show_header=False)
    for label, value in _figures(report):
        figures.add_row(label, Text(value))
    console.print(figures)
    for note in report.notes:
        console.print(f"• {note}", markup=False)


def _figures(report: RecordingReport) -> list[tuple[str, str]]:
    exposure, pixels, motion, timing = report.exposures.course, report.pixels, report.motion, report.timing
    cycle = "" if exposure.cycle_frames is None else f", repeating every {exposure.cycle_frames} frames"
    rows = [
        (
            "exposure",
            f"{exposure.lowest_ms:.4g} to {exposure.highest_ms:.4g} ms (a factor of {exposure.ratio:.3g}), "
            f"changes in {exposure.changed_share:.0%} of the frames{cycle}",
        ),
        ("exposure lag", _lag(report)),
    ]
    if report.exposures.brightness is not None:
        rows.append(
            (
                "brightness",
                f"ln grey of the same things changes by {report.exposures.brightness.change_rms_log:.4f} a frame; "
                f"{report.exposures.brightness.unexplained_rms_log:.4f} are not explained by the exposures",
            )
        )
    radii = " ".join("-" if math.isnan(share) else f"{share * 100:.0f}" for share in pixels.mean_radius_share)
    speed = "unknown" if math.isnan(motion.median_px_per_frame) else f"{motion.median_px_per_frame:.2g} px a frame"
    rate = "" if math.isnan(timing.interval_s) else f"{1 / timing.interval_s:.4g} a second; "
    rows += [
        (
            "grey levels",
            f"{pixels.covered_grey.mean():.0%} occur, from {pixels.lowest_grey} to {pixels.highest_grey} of "
            f"{pixels.max_grey}; {pixels.saturated_share:.1%} saturated, {pixels.black_share:.1%} black",
        ),
        ("radii", f"well exposed from centre to corner: {radii} %"),
        (
            "motion",
            f"{speed}; radial {motion.radial_reach:.2f} of the half diagonal; {motion.found_share:.0%} found again "
            f"in the next frame",
        ),
        (
            "frames",
            f"{rate}{timing.dropped_frames} missing; {len(timing.duplicate_frames)} of {timing.compared_frames} "
            f"repeat the one before",
        ),
    ]
    return rows


def _lag(report: RecordingReport) -> str:
    lag = report.exposures.lag
    if lag.frames is None:
        candidates = f" (one of {', '.join(map(str, lag.candidates))})" if len(lag.candidates) > 1 else ""
        return f"not determinable: {lag.state}{candidates}"
    return f"{lag.frames} frames, from {lag.pairs} pairs of frames"
