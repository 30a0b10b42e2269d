"""The outcome of a calibration and its folder: the output of every command that calibrates one camera."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

from ospc.cli.interruption import Interruption
from ospc.cli.terminal import (
    COMPLETE,
    FAILED,
    INTERRUPTED,
    UNDETERMINED,
    progress_line,
    say,
    say_notes,
    say_table,
    styled,
)
from ospc.engine.frame_checks import skipped_in_words
from ospc.engine.state import Epoch
from ospc.errors import FormatError, counted
from ospc.evaluation.comparison import Comparison, compare
from ospc.evaluation.metrics import Coverage
from ospc.formats.opening import Photometry
from ospc.photometry.calibration import Calibration
from ospc.photometry.verdict import Verdict
from ospc.recording import Recording
from ospc.report.output_folder import OutputFolder, Times, Written
from ospc.report.pictures import drawings_of
from ospc.state.container import STATE_NAME
from ospc.system.second_thread import SecondThread

_STYLES = {"identifiable": "green", "marginal": "yellow", "not identifiable": "red"}
_WIDTH_WHEN_PIPED = 110
"""Characters per line of a table outside a terminal."""
_ERRORS = {
    "response_rmse": "response, RMSE of g",
    "response_shape_rmse": "response shape, RMSE after the best scale",
    "log_ratio_error": "response, log-ratio error κ",
    "vignette_rmse": "vignette, RMSE of the radial profile",
    "vignette_pixel_rmse": "vignette, RMSE over all pixels",
}
"""Labels of the metrics of a comparison with a truth."""
Save: TypeAlias = Callable[[Path], Path]
"""Writes a state to a file, and returns its path; FormatError if that fails."""


@dataclass(frozen=True)
class CalibrationOutcome:
    """A calibration, marked partial if the run did not finish, and its recording, None if there is none.

    ``skipped`` contains the first reasons for skipped frames; ``failure`` is the error, or empty. ``ended`` contains
    the epochs that a change of the camera ended.
    """

    calibration: Calibration
    recording: Recording | None = None
    skipped: tuple[str, ...] = ()
    interrupted: bool = False
    failure: str = ""
    ended: tuple[Epoch, ...] = ()

    @property
    def exit_code(self) -> int:
        """Exit code of the command."""
        if self.failure:
            return FAILED
        if self.interrupted:
            return INTERRUPTED
        return COMPLETE if self.calibration.complete else UNDETERMINED

    def basis(self) -> Iterator[str]:
        """Return lines that describe the data behind the calibration."""
        counts, partial = self.calibration.counts, self.calibration.partial
        nouns = ("recording", "frame", "pair", "sample")
        seen = {noun: counted(counts[f"{noun}s"], noun) for noun in nouns if f"{noun}s" in counts}
        if partial and self.recording is not None:
            seen["frame"] = f"{counts['frames']} of {counted(len(self.recording), 'frame')}"
        yield f"from {', '.join(seen.values())}"
        if self.interrupted:
            yield "partial: the run was interrupted"
        elif partial:
            yield "partial: the run failed before the end of the recording"


@dataclass(frozen=True)
class ResultFolder:
    """The folder of a result, and how the result is reported.

    ``times`` has the time stamps of the frames if there is no recording. With ``as_json``, the caller prints the
    result. An interruption while files are written only leaves out the picture. ``second`` draws.
    """

    folder: OutputFolder
    interruption: Interruption
    quiet: bool = False
    as_json: bool = False
    truth: Photometry | None = None
    times: Times | None = None
    second: SecondThread = field(default_factory=SecondThread)

    @property
    def prints_text(self) -> bool:
        """Whether to print more than errors and warnings."""
        return not (self.quiet or self.as_json)

    def take(self, outcome: CalibrationOutcome, save: Save | None, notes: Sequence[str] = ()) -> dict[str, Any]:
        """Write the folder, print the result with notes on the run, and return it as JSON-compatible values.

        ``save`` writes the state; with None, that of an earlier run is removed. A partial result never replaces a
        complete one.
        """
        folder = self.folder.for_partial_results if outcome.calibration.partial else self.folder
        content = replace(self, folder=folder)._taken(outcome, save, notes)
        if not content["partial"]:
            self.folder.remove_partial()
        return content

    def _taken(self, outcome: CalibrationOutcome, save: Save | None, notes: Sequence[str]) -> dict[str, Any]:
        with self.interruption.held():
            self.folder.create()
            with progress_line(quiet=self.quiet) as show_writing, ThreadPoolExecutor(1, "ospc-state") as second:
                show_writing("writing", 0, 0)
                # In parallel: most of it is compression, which releases the interpreter.
                saving = second.submit(self._saved, save)
                outcome, written = self._written(outcome)
            written += saving.result()
            comparison = self._compared(outcome.calibration)
            if not self.quiet:
                for warning in outcome.calibration.warnings:
                    say(styled("WARNING", fg="red", bold=True), f": {warning}", err=True)
            if self.prints_text:
                say_notes((*outcome.calibration.notes, *notes))
                self._say(outcome, written, comparison)
            return self._as_dict(outcome, written, notes, comparison)

    def _saved(self, save: Save | None) -> Written:
        place = self.folder.path / STATE_NAME
        try:
            if save is not None:
                return Written((save(place),))
            place.unlink(missing_ok=True)
        except (FormatError, OSError) as error:
            # Continue: the result matters more, and the images of a camera are not kept.
            return Written(notes=(f"no state was saved: {error}",))
        return Written()

    def _written(self, outcome: CalibrationOutcome) -> tuple[CalibrationOutcome, Written]:
        """Write data, report and picture; an interruption leaves out the picture only."""
        folder, recording, before = self.folder, outcome.recording, self.interruption.count
        written = folder.write(outcome.calibration, self.times if recording is None else recording, outcome.ended)
        if not written.problems:
            findings = folder.findings(outcome.calibration, recording, self.truth)
            drawing = self.second.submit(drawings_of, findings)  # while examples are computed
            written += folder.report(findings, recording, drawing=drawing)
            written += folder.draw(findings, stop=lambda: self.interruption.count > before, drawing=drawing)
        if self.interruption.requested and not outcome.interrupted:
            unfinished = replace(outcome.calibration, partial=True)
            unfinished.save(folder.path / "calibration.json")
            outcome = replace(outcome, calibration=unfinished, interrupted=True)
        failure = "; ".join(filter(None, (outcome.failure, *written.problems)))
        return replace(outcome, failure=failure), written

    def _compared(self, calibration: Calibration) -> Comparison | None:
        """Return the errors against a truth; None without one, or if the two share no known part."""
        estimate = Photometry("estimate", calibration.response, calibration.vignette, calibration)
        try:
            return None if self.truth is None else compare(estimate, self.truth)
        except FormatError:
            return None

    def _say(self, outcome: CalibrationOutcome, written: Written, comparison: Comparison | None) -> None:
        """Print skipped frames, verdicts, the data behind them, the files, and the errors against a truth."""
        calibration, folder, truth = outcome.calibration, self.folder.path, self.truth
        counts, ratios = calibration.counts, calibration.exposure_ratios
        if counts.get("skipped"):
            say_notes([skipped_in_words(counts["skipped"], counts["frames"], outcome.skipped)])
        say_verdicts(calibration.verdicts, calibration.warnings)
        for line in outcome.basis():
            say(line)
        say(f"written to {folder}: {', '.join(str(file.relative_to(folder)) for file in written.files)}")
        say_notes(written.notes)
        if truth is None:
            return
        say()
        if comparison is None:
            say(f"nothing to compare with {truth.name}: the estimate lacks the parts that it contains")
            return
        say(f"errors against {truth.name}:")
        rows = error_rows(comparison)
        if ratios.metadata.size:
            rows["exposure ratios, median |Δ ln k| (bias)"] = f"{ratios.misfit:.4f} ({ratios.bias:+.4f})"
        for label, figure in rows.items():
            say(f"  {label:42} {figure}")

    def _as_dict(
        self, outcome: CalibrationOutcome, written: Written, notes: Sequence[str], comparison: Comparison | None
    ) -> dict[str, Any]:
        calibration, ratios = outcome.calibration, outcome.calibration.exposure_ratios
        of_recording = () if outcome.recording is None else outcome.recording.notes
        content: dict[str, Any] = {
            "exit_code": outcome.exit_code,
            "out": str(self.folder.path),
            "partial": calibration.partial,
            "verdicts": {name: vars(verdict) for name, verdict in calibration.verdicts.items()},
            "converged": calibration.converged,
            "exponent_sigma": calibration.exponent_sigma,
            "counts": calibration.counts,
            "advice": list(calibration.advice),
            "warnings": list(calibration.warnings),
            "files": [str(file) for file in written.files],
        }
        if ratios.metadata.size:
            content["exposure_ratios"] = {"median_abs_log_error": ratios.misfit, "bias": ratios.bias}
        if comparison is not None:
            content["errors"] = errors_as_dict(comparison)
        return content | {
            "interrupted": outcome.interrupted,
            "error": outcome.failure or None,
            "skipped": list(outcome.skipped),
            "exposure_lag_frames": calibration.source.get("exposure_lag_frames"),
            "exposure_lag_corrected_frames": calibration.source.get("exposure_lag_corrected_frames", 0),
            "notes": [*of_recording, *calibration.notes, *notes, *written.notes],
        }


def say_verdicts(verdicts: Mapping[str, Verdict], warnings: Sequence[str] = ()) -> None:
    """Print the verdicts with their reasons and remedies; warnings that were printed before are not repeated."""
    from rich.text import Text

    see = "see the warning" if len(warnings) == 1 else "see the warnings"
    rows, first = [], dict[str, str]()
    for name, verdict in verdicts.items():
        why = verdict.reason
        for warning in warnings:
            why = why.replace(warning, see)
        if verdict.remedy:
            same = first.setdefault(verdict.remedy, name)
            why += f"\n→ {verdict.remedy if same == name else f'as for the {same}'}"
        rows.append((Text(name), Text(verdict.state, style=_STYLES[verdict.state]), Text(why)))
    say()
    say_table(("", "state", "why, and what to record instead"), rows, columns_when_piped=_WIDTH_WHEN_PIPED)
    say()


def error_rows(comparison: Comparison) -> dict[str, str]:
    """Return the known figures of a comparison as text, by label."""
    figures = {label: getattr(comparison, name) for name, label in _ERRORS.items()}
    rows = {label: f"{figure:.4f}" for label, figure in figures.items() if figure is not None}
    for part, share in _coverages(comparison).items():
        rows[f"{part} within ±1σ / ±2σ"] = f"{share.within_1_sigma:.0%} / {share.within_2_sigma:.0%}"
    return rows


def errors_as_dict(comparison: Comparison) -> dict[str, Any]:
    """Return the figures of a comparison as JSON-compatible values."""
    figures: dict[str, Any] = {name: getattr(comparison, name) for name in _ERRORS}
    return figures | {f"{part}_coverage": share._asdict() for part, share in _coverages(comparison).items()}


def _coverages(comparison: Comparison) -> dict[str, Coverage]:
    """Return the known coverages of a comparison by part."""
    coverages = {"response": comparison.response_coverage, "vignette": comparison.vignette_coverage}
    return {part: share for part, share in coverages.items() if share is not None}
