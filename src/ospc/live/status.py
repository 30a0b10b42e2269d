"""Status of a live calibration: the latest estimate, what to film next, and when to estimate again."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass, replace

from ospc.calibrator import OnlineCalibrator
from ospc.engine.state import Epoch
from ospc.errors import counted
from ospc.live.advice import Adviser, Instruction
from ospc.methods.method import Progress
from ospc.methods.preview import Preview
from ospc.photometry.calibration import Calibration
from ospc.settings.live import (
    CONFIRMING_FRAMES,
    ESTIMATE_GROWTH,
    FIRST_ESTIMATE_FRAMES,
    LATEST_FRAMES,
    MAX_UNUSABLE_FRAMES,
    UNKNOWN_GROWTH,
)

MOST_NOTES = 20
"""Number of latest notes to keep."""


@dataclass(frozen=True)
class LiveStatus:
    """Status of a live calibration, available without waiting.

    Attributes
    ----------
    frames
        Number of frames pushed so far.
    processed
        Number of frames that the background thread has processed.
    dropped
        Number of frames that were needed, but dropped because the queue was full.
    unusable, reasons
        Number of frames that could not be used, and why, in order.
    converged, converged_after
        Whether response and vignette were identifiable at the latest estimate, and the number of frames pushed when
        they first were; None before.
    notes
        When they became identifiable, and how the camera changed since.
    epochs
        The epochs of the camera; each change of the camera starts a new one. Past epochs hold their calibration.
    progress
        Figures specific to the method.
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
        """What to film next, as text: one instruction at a time, until the capture is done."""
        return self.instruction.text


class LiveFindings:
    """Findings of the background thread; only that thread calls the methods, any thread may read the attributes."""

    def __init__(self, engine: OnlineCalibrator, goal: float) -> None:
        self._engine = engine
        self._adviser = Adviser(goal)
        self.preview: Preview | None = None
        self.latest: Calibration | None = None
        self._converged_after: int | None = None
        self._notes: tuple[str, ...] = ()
        self._confirmed: Calibration | None = None  # the latest one, unless the camera has changed since
        self._estimated_after = self._estimated_frames = 0
        self._next_estimate = FIRST_ESTIMATE_FRAMES
        self._known_epochs, self._begun_after = 1, 0  # and the frames processed when the current epoch began
        self._used: deque[bool] = deque(maxlen=LATEST_FRAMES)

    def status(self, pushed: int, dropped: int, unusable: int) -> LiveStatus:
        """Return the status after this many frames."""
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
        """Return a complete estimate after this many pushed frames, computed once for simultaneous requests."""
        if self.latest is not None and self._estimated_frames == self._engine.frames:
            return self.latest
        found = self._engine.calibration()
        if found.converged and (self.latest is None or not self.latest.converged):
            self._note(f"response and vignette are known after {counted(pushed, 'frame')}")
            self._converged_after = self._converged_after or pushed
        self.latest = self._confirmed = found
        self._estimated_after, self._estimated_frames = self._engine.processed, self._engine.frames
        growth = ESTIMATE_GROWTH if found.converged else UNKNOWN_GROWTH
        of_epoch = int(growth * (self._estimated_after - self._begun_after))
        self._next_estimate = self._begun_after + max(FIRST_ESTIMATE_FRAMES, of_epoch)
        return found

    def follow(self, pushed: int, *, used: bool = True) -> None:
        """After a frame, used or not, check for a change of the camera, and estimate if due."""
        self._used.append(used)
        epochs, processed = self._engine.epochs, self._engine.processed
        if len(epochs) > self._known_epochs:
            change, self._known_epochs, self._begun_after = epochs[-2].change, len(epochs), processed
            self._next_estimate, self._confirmed = processed + FIRST_ESTIMATE_FRAMES, None
            if change is not None:
                self._note(change.text)
                if self.latest is not None:
                    warnings = (*self.latest.warnings, f"{change.text}; the calibration is for earlier frames")
                    self.latest = replace(self.latest, converged=False, warnings=warnings)
        if processed >= self._next_estimate:
            self.estimate(pushed)

    def advise(self, pushed: int) -> None:
        """Choose what to film next from quick estimates."""
        self.preview = self._engine.preview()
        reasons = self._engine.status.skipped
        unusable = reasons[-1] if reasons and self._used.count(False) > MAX_UNUSABLE_FRAMES else ""
        now = self._adviser.look(self.preview, time.monotonic(), self._confirmed, unusable)
        due = self._engine.processed >= self._estimated_after + CONFIRMING_FRAMES
        if due and now.kind != "done" and self._adviser.expects_end:
            self.estimate(pushed)  # quick estimates omit errors that only a complete one finds

    def _note(self, text: str) -> None:
        self._notes = (*self._notes, text)[-MOST_NOTES:]
