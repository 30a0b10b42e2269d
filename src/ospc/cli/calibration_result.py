"""How a calibration ended, and its folder: what every command that calibrates one camera writes and says."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

from ospc.cli.calibration_report import result_as_dict, say_notes, say_result
from ospc.cli.interruption import INTERRUPTED, Interruption
from ospc.cli.options import COMPLETE, UNDETERMINED
from ospc.cli.progress import progress_line
from ospc.cli.terminal import say, styled
from ospc.errors import counted

if TYPE_CHECKING:
    from ospc.formats.opening import Photometry
    from ospc.output import OutputFolder, Times, Written
    from ospc.photometry.calibration import Calibration
    from ospc.recording import Recording

FAILED = 1
"""Exit code of a run that failed; a partial result is written."""

Saved: TypeAlias = "tuple[Written, list[str]]"
"""What was written of a state, and notes on it."""


@dataclass(frozen=True)
class Outcome:
    """A calibration, marked partial if the run did not come to its end.

    ``skipped`` has the first reasons for skipped frames, ``failure`` what went wrong; it is empty if nothing did.
    """

    calibration: Calibration
    skipped: tuple[str, ...] = ()
    interrupted: bool = False
    failure: str = ""

    @property
    def exit_code(self) -> int:
        """Exit code of the command."""
        if self.failure:
            return FAILED
        if self.interrupted:
            return INTERRUPTED
        return COMPLETE if self.calibration.complete else UNDETERMINED

    @property
    def skipping(self) -> Iterator[str]:
        """What to note on skipped frames: how many there were, and why the first few were."""
        counts = self.calibration.counts
        if counts.get("skipped"):
            more = "; …" if counts["skipped"] > len(self.skipped) else ""
            of = counted(counts["frames"], "frame")
            yield f"{counts['skipped']} of {of} skipped: {'; '.join(self.skipped)}{more}"

    def basis(self, recording: Recording | None) -> Iterator[str]:
        """Return what the calibration rests on, as lines."""
        counts, partial = self.calibration.counts, self.calibration.partial
        nouns = ("recording", "frame", "pair", "sample")
        seen = {noun: counted(counts[f"{noun}s"], noun) for noun in nouns if f"{noun}s" in counts}
        if partial and recording is not None:
            seen["frame"] = f"{counts['frames']} of {counted(len(recording), 'frame')}"
        yield f"from {', '.join(seen.values())}"
        if self.interrupted:
            yield "partial: the run was interrupted; more frames would tell more"
        elif partial:
            yield "partial: the run failed before its end"


@dataclass(frozen=True)
class ResultFolder:
    """Where a result goes, and how it is reported.

    ``recording`` is None where there is none; ``times`` then says when frames were taken. With ``as_json``,
    somebody else prints the result. An interruption while files are written only leaves out pictures.
    """

    folder: OutputFolder
    recording: Recording | None
    interruption: Interruption
    quiet: bool = False
    as_json: bool = False
    truth: Photometry | None = None
    pdf: bool = False
    times: Times | None = None

    @property
    def talkative(self) -> bool:
        """Whether to print more than errors and warnings."""
        return not (self.quiet or self.as_json)

    def take(self, outcome: Outcome, saved: Callable[[], Saved]) -> dict[str, Any]:
        """Write the folder, print the result, and return it as JSON-compatible values.

        ``saved`` waits for the state.
        """
        with self.interruption.held():
            with progress_line(quiet=self.quiet) as show_writing:
                show_writing("writing", 0, 0)
                outcome, written = self._written(outcome)
            state, notes = saved()
            written += state
            self._say(outcome, written, notes)
            return self._as_dict(outcome, written, notes)

    def _written(self, outcome: Outcome) -> tuple[Outcome, Written]:
        """Write data, report, then pictures; an interruption now only leaves out pictures."""
        folder, before = self.folder, self.interruption.count
        written = folder.write(outcome.calibration, self.times if self.recording is None else self.recording)
        if not written.problems:
            with ThreadPoolExecutor(1) as second:
                # The report follows points through images, which leaves the interpreter to whoever draws.
                report = second.submit(folder.report, outcome.calibration, self.recording, self.truth, pdf=self.pdf)
                if self.pdf:
                    report.result()  # drawn as the pictures are, which is not to be done twice at once
                drawn = folder.draw(outcome.calibration, self.truth, stop=lambda: self.interruption.count > before)
                written += report.result() + drawn
        if self.interruption.requested and not outcome.interrupted:
            unfinished = replace(outcome.calibration, partial=True)
            unfinished.save(folder.path / "calibration.json")
            outcome = replace(outcome, calibration=unfinished, interrupted=True)
        failure = "; ".join(filter(None, (outcome.failure, *written.problems)))
        return replace(outcome, failure=failure), written

    def _say(self, outcome: Outcome, written: Written, notes: list[str]) -> None:
        calibration = outcome.calibration
        if self.quiet:
            return
        for warning in calibration.warnings:
            say(styled("WARNING", fg="red", bold=True), f": {warning}", err=True)
        if calibration.warnings:
            remedy = calibration.verdicts["exposures"].remedy
            say(f"  response and vignette are marginal at best; {remedy}", err=True)
        if self.as_json:
            return
        say_notes((*calibration.notes, *notes))
        say_notes(outcome.skipping, "warning")
        say_result(calibration, self.folder, written, self.truth, outcome.basis(self.recording))

    def _as_dict(self, outcome: Outcome, written: Written, notes: list[str]) -> dict[str, Any]:
        calibration = outcome.calibration
        of_recording = () if self.recording is None else self.recording.notes
        return {
            "exit_code": outcome.exit_code,
            **result_as_dict(calibration, self.folder, written, self.truth),
            "interrupted": outcome.interrupted,
            "error": outcome.failure or None,
            "skipped": list(outcome.skipped),
            "exposure_lag_frames": calibration.source.get("exposure_lag_frames"),
            "exposure_lag_corrected_frames": calibration.source.get("exposure_lag_corrected_frames", 0),
            "notes": [*of_recording, *calibration.notes, *notes, *written.notes],
        }
