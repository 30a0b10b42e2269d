"""``ospc check``: whether a recording is suitable for calibration, and its problems."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ospc.cli.options import AS_JSON, CORRECT_LAG, LIST_TOPICS, PLOT, argument, declared, option
from ospc.cli.reading import READING_OR_ESTIMATING, Reading, print_topics
from ospc.cli.terminal import COMPLETE, UNDETERMINED, print_json, progress_of, say
from ospc.errors import counted, plain

if TYPE_CHECKING:
    from ospc.diagnosis import RecordingReport
    from ospc.exposures.lag_choice import LagChoice

_LABEL_COLUMNS = 14
"""Width of the labels of the figures."""


@declared(
    "check",
    exits={
        COMPLETE: "a calibration would be complete",
        UNDETERMINED: "response, vignette or exposures are marginal or not identifiable, or the camera changed",
    },
)
def command(
    *,
    path: Path = argument(),
    as_json: bool = AS_JSON,
    plot: Path | None = PLOT,
    frames: int | None = option("Use only the first N frames.", metavar="N", type=click.IntRange(min=2)),
    correct_lag: LagChoice = CORRECT_LAG,
    reading: Reading = READING_OR_ESTIMATING,
    list_topics: bool = LIST_TOPICS,
) -> int:
    """Check the recording at PATH by calibrating it, without writing a calibration.

    Uses the whole recording, or its beginning (--frames). Reports whether response, vignette and exposures are
    identifiable, and what to record instead; whether each exposure belongs to its frame; and what in the recording
    would spoil a calibration. The verdicts are those of 'ospc calibrate' on the same frames.
    """
    from ospc.cli.calibration_result import say_verdicts
    from ospc.diagnosis import check_recording

    if list_topics:
        print_topics(path)
        return COMPLETE
    if reading.options.unknown_exposures and correct_lag != "auto":
        raise click.UsageError("--unknown-exposures cannot be combined with --correct-lag")
    recording = reading.open(path)
    if reading.options.unknown_exposures:
        from ospc.unknown_exposures import recover_exposures

        with progress_of("exposures") as step:
            recording = recover_exposures(recording, step)
    with progress_of("checking") as step:
        report = check_recording(recording, frames=frames, correct_lag=correct_lag, progress=step)
    code = COMPLETE if report.complete else UNDETERMINED
    if plot is not None:
        from ospc.report.check import plot_report

        plot_report(report, plot)
    if as_json:
        print_json(report.as_dict())
        return code
    width, height = report.size
    say(f"{path}: {counted(report.frames, 'frame')} of {width}×{height} pixels, {report.processed} of them processed")
    say_verdicts(report.verdicts)
    unit = "" if reading.options.unknown_exposures else " ms"
    for label, figure in _figures(report, unit).items():
        say(f"{label:{_LABEL_COLUMNS}}{figure}")
    say()
    for note in report.notes:
        say(f"• {note}")
    if plot is not None:
        say(f"plot: {plot}")
    return code


def _figures(report: RecordingReport, unit: str) -> dict[str, str]:
    """Return the known figures as text, by label."""
    exposure, pixels, motion, timing = report.exposures.evidence.recorded, report.pixels, report.motion, report.timing
    cycle = "" if exposure.cycle_frames is None else f", repeating every {exposure.cycle_frames} frames"
    course = (
        "in all frames"
        if exposure.values == 1
        else f"(a factor of {plain(exposure.ratio, 3)}), changes in {exposure.changed_share:.0%} of the frames{cycle}"
    )
    rows = {"exposure": f"{exposure.in_words(unit)} {course}", "exposure lag": _lag(report)}
    brightness = report.exposures.brightness
    if brightness is not None:
        rows["brightness"] = (
            f"the same points change by {brightness.change_rms_log:.2%} per frame, "
            f"of which the exposures leave {brightness.unexplained_rms_log:.2%} unexplained"
        )
    radii = " ".join("-" if math.isnan(share) else f"{share * 100:.0f}" for share in pixels.mean_radius_share)
    speed = "unknown" if math.isnan(motion.median_px_per_frame) else f"{motion.median_px_per_frame:.2g} px per frame"
    share = motion.found_share
    found = "" if math.isnan(share) else f"; {share:.0%} of the points found again in the next frame"
    rate = "" if math.isnan(timing.interval_s) else f"{1 / timing.interval_s:.4g} per second; "
    return rows | {
        "grey levels": f"{pixels.covered_grey.mean():.0%} occur, from {pixels.lowest_grey} to {pixels.highest_grey} "
        f"of {pixels.max_grey}; {pixels.saturated_share:.1%} saturated, {pixels.black_share:.1%} black",
        "radii": f"well exposed from centre to corner: {radii} %",
        "motion": f"{speed}; radial {motion.radial_motion:.2f} of the half diagonal{found}",
        "frames": f"{rate}{timing.dropped_frames} missing; {timing.duplicates} of "
        f"{timing.compared_frames} repeat the previous one",
    }


def _lag(report: RecordingReport) -> str:
    from ospc.exposures.verdicts import either

    lag, cycle = report.exposures.lag, report.exposures.evidence.recorded.cycle_frames
    certain = lag.certain_frames(cycle)
    if certain is None:
        candidates = f" (lags of {either(lag)})" if len(lag.candidates) > 1 else ""
        return f"not determined: {lag.state}{candidates}"
    if lag.frames is None:
        return f"{counted(certain, 'frame')}, or whole cycles of {cycle} more or less, with the same exposures"
    return f"{counted(lag.frames, 'frame')}, from {counted(lag.pairs, 'pair')} of frames"
