"""Where a live calibration stands: the latest estimate, what to film next, and when to estimate again."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from ospc.calibrator import OnlineCalibrator
from ospc.engine_state import Epoch
from ospc.errors import counted
from ospc.live.advice import Adviser, Instruction
from ospc.methods.method import Progress
from ospc.methods.preview import Preview
from ospc.photometry.calibration import Calibration

FIRST_ESTIMATE, ESTIMATE_GROWTH = 48, 4
"""Frames processed before the first estimate that nobody asked for, and how many times as many as at the last one,
whoever asked for it, before each next: with twice as many, these took a quarter of the processor time of the first
half minute."""

CONFIRMING = 12
"""Frames processed before the next estimate where the information so far says that the goal may be reached."""

MOST_NOTES = 20
"""Latest notes that are kept."""


@dataclass(frozen=True)
class LiveStatus:
    """Where a live calibration stands; taken without waiting.

    Attributes
    ----------
    frames
        Frames pushed so far.
    processed
        Frames that the background has processed.
    dropped
        Frames that should have been processed, but too many images were waiting.
    unusable, reasons
        Frames that could not be used, and why, the latest last.
    converged, converged_after
        Whether response and vignette were identifiable at the latest estimate, and the frames pushed when they first
        were; None before.
    notes
        When they became known, and whether and how the camera changed since.
    epochs
        The epochs of the camera, one more than it changed. Those that ended hold their calibration.
    progress
        The method's own figures.
    instruction
        What to film next, and why.
    """

    frames: int
    processed: int
    dropped: int
    unusable: int
    reasons: tuple[str, ...]
    converged: bool
    converged_after: int | None
    notes: tuple[str, ...]
    epochs: tuple[Epoch, ...]
    progress: Progress
    instruction: Instruction

    @property
    def advice(self) -> str:
        """What to film next, as text: one instruction at a time, until it says that it is done."""
        return self.instruction.text


class Findings:
    """What the background finds out about a run; only it calls the methods, and anybody may read the attributes."""

    def __init__(self, engine: OnlineCalibrator, goal: float) -> None:
        self._engine = engine
        self._adviser = Adviser(goal)
        self.preview: Preview | None = None
        self.latest: Calibration | None = None
        self._converged_after: int | None = None
        self._notes: tuple[str, ...] = ()
        self._confirmed: Calibration | None = None  # the latest, unless the camera has changed since
        self._estimated_after = self._estimated_frames = 0
        self._next_estimate = FIRST_ESTIMATE
        self._known_epochs = 1

    def status(self, pushed: int, dropped: int, unusable: int) -> LiveStatus:
        """Return where the run stands, after so many frames."""
        status = self._engine.status
        return LiveStatus(
            frames=pushed,
            processed=self._engine.processed,
            dropped=dropped,
            unusable=unusable,
            reasons=status.skipped,
            converged=self.latest is not None and self.latest.converged,
            converged_after=self._converged_after,
            notes=self._notes,
            epochs=self._engine.epochs,
            progress=status.progress,
            instruction=self._adviser.instruction,
        )

    def estimate(self, pushed: int) -> Calibration:
        """Return a complete estimate after so many frames were pushed, made once for all that ask together."""
        if self.latest is not None and self._estimated_frames == self._engine.frames:
            return self.latest
        found = self._engine.calibration()
        if found.converged and (self.latest is None or not self.latest.converged):
            self._note(f"response and vignette are known after {counted(pushed, 'frame')}")
            self._converged_after = self._converged_after or pushed
        self.latest = self._confirmed = found
        self._estimated_after, self._estimated_frames = self._engine.processed, self._engine.frames
        self._next_estimate = max(FIRST_ESTIMATE, ESTIMATE_GROWTH * self._estimated_after)
        return found

    def follow(self, pushed: int) -> None:
        """Notice a change of the camera after a frame was processed, and estimate if it is time to."""
        epochs, processed = self._engine.epochs, self._engine.processed
        if len(epochs) > self._known_epochs:
            change, self._known_epochs = epochs[-2].change, len(epochs)
            if change is not None:
                self._note(change.text)
            self._next_estimate, self._confirmed = processed + FIRST_ESTIMATE, None
            if self.latest is not None:
                self.latest = replace(self.latest, converged=False)
        if processed >= self._next_estimate:
            self.estimate(pushed)

    def advise(self, pushed: int) -> None:
        """Choose what to film next, by quick estimates."""
        self.preview = self._engine.preview()
        now = self._adviser.look(self.preview, time.monotonic(), self._confirmed)
        due = self._engine.processed >= self._estimated_after + CONFIRMING
        if due and now.kind != "done" and self._adviser.expects_end:
            self.estimate(pushed)  # quick figures leave out what only a complete estimate finds

    def _note(self, text: str) -> None:
        self._notes = (*self._notes, text)[-MOST_NOTES:]
