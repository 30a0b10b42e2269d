"""Check the exposures of a run against the images as the frames arrive."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ospc.exposures.brightness_history import BrightnessHistory
from ospc.exposures.evidence import evidence_of_images
from ospc.exposures.findings import ExposureFindings
from ospc.exposures.lag_change import LagChange, detect_lag_change
from ospc.exposures.lag_choice import LagChoice, checked_lag_choice, leaves_frames
from ospc.exposures.table import ExposureTable
from ospc.exposures.verdicts import findings_from
from ospc.settings.exposures import (
    ASSESSMENT_GROWTH,
    EXPOSURE_CHANGE_FRAMES,
    FIRST_ASSESSMENT_CHANGES,
    LAG_CHECK_INTERVAL_CHANGES,
    LAG_SEARCH_CHANGES,
    MIN_EXPOSURE_CHANGE_LOG,
    SUSPECTED_LAG_CHECK_INTERVAL_CHANGES,
)
from ospc.system.library_threads import one_blas_thread


@dataclass
class ExposureMonitor:
    """Keeps the exposures of a run and checks them against the brightness changes."""

    choice: LagChoice
    """What to do about a lag; SettingError if it is not a :data:`~ospc.exposures.lag_choice.LagChoice`."""
    table: ExposureTable = field(default_factory=ExposureTable)
    """The exposures recorded so far, and the lag that is corrected during the run."""
    history: BrightnessHistory = field(default_factory=BrightnessHistory)
    """The brightness changes between consecutive frames of this epoch."""
    _first_frame: int = 0
    _next_assessment: int = FIRST_ASSESSMENT_CHANGES
    """Number of brightness changes at which the exposures are assessed again."""
    _known_lag: int | None = None
    """The latest lag that was certain; a fit to the moved exposures must have confirmed it, unless it is 0."""
    _suspected_lag: int = 0
    """Suspected change of that lag at the latest check, in frames; 0 if there is no suspicion."""

    def __post_init__(self) -> None:
        self.choice = checked_lag_choice(self.choice)
        if isinstance(self.choice, int):
            self.table.lag_frames = self.choice
        self._findings: tuple[tuple[int, int, int], ExposureFindings] | None = None

    @property
    def assessment_is_due(self) -> bool:
        """Whether many brightness changes have been added since the latest assessment."""
        enough = self.history.observed >= self._next_assessment
        return enough and leaves_frames(self.choice, len(self.table) - self._first_frame)

    def is_new_lag(self, found: ExposureFindings) -> bool:
        """Return whether findings would correct another lag than that known so far; without any, 0 is expected."""
        return self.choice == "auto" and _certain_lag(found) not in (None, self._known_lag or 0)

    def adopt(self, found: ExposureFindings) -> None:
        """Use the findings of an assessment until the next one."""
        self._next_assessment = int(ASSESSMENT_GROWTH * self.history.observed)
        self.table.lag_frames = found.corrected_frames
        certain = _certain_lag(found)
        self.table.trusted = certain is not None and not found.warnings
        # If the lag becomes uncertain, keep the known one to detect its change.
        if certain is not None and (not self.is_new_lag(found) or found.evidence.fit_shows_no_lag):
            self._known_lag = certain

    def findings(self) -> ExposureFindings:
        """Return what the images show about the exposures of this epoch so far."""
        return self.findings_before(len(self.table))

    def findings_before(self, frame: int) -> ExposureFindings:
        """Return what the images show about the exposures of this epoch before a frame."""
        key = (frame, len(self.table), len(self.history))
        if self._findings is None or self._findings[0] != key:
            changes, log_recorded = self.history.before(frame), self.table.log_recorded[:frame]
            # The matrices are small: more BLAS threads would only wait for each other.
            with one_blas_thread():
                seen = evidence_of_images(changes, log_recorded, self.choice, first_frame=self._first_frame)
                self._findings = (key, findings_from(seen))
        return self._findings[1]

    def detect_lag_change(self, *, camera_changed: bool) -> LagChange | None:
        """Return a change of the lag if it is proven and the previous check already suspected it.

        The check runs at intervals. If another change of the camera was detected, which a change of the lag may
        explain, it runs at once, and needs no earlier suspicion.
        """
        if self._known_lag is None:
            return None
        interval = SUSPECTED_LAG_CHECK_INTERVAL_CHANGES if self._suspected_lag else LAG_CHECK_INTERVAL_CHANGES
        if not camera_changed and len(self.history) % interval:
            return None
        with one_blas_thread():
            found = detect_lag_change(self.history.changes, self.table.log_recorded, self._known_lag)
        suspected, self._suspected_lag = self._suspected_lag, 0 if found is None else found.later_frames
        if found is None or not found.proven or not (camera_changed or suspected * found.later_frames > 0):
            return None
        return found

    def follow_lag_change(self, change: LagChange) -> None:
        """Move the exposures by a changed lag from now on, unless the user has chosen a lag."""
        if self.choice == "auto" and self._known_lag is not None:
            self.table.lag_frames = self._known_lag + change.later_frames

    @property
    def lag_is_uncertain(self) -> bool:
        """Whether more brightness changes may still help to determine the lag."""
        if self.choice == "estimated":
            return False
        return self._suspected_lag != 0 or (len(self.history) < LAG_SEARCH_CHANGES and not self.table.trusted)

    def needs_comparison(self, number: int) -> bool:
        """Return whether comparing a frame with the previous one helps to find the lag: its exposure has changed."""
        recent = self.table.log_recorded[max(0, number - EXPOSURE_CHANGE_FRAMES) : number + 1]
        return self.lag_is_uncertain and float(np.nanmax(recent) - np.nanmin(recent)) > MIN_EXPOSURE_CHANGE_LOG

    def begin_epoch(self, frame: int) -> None:
        """Start an epoch at a frame."""
        self.history, self._first_frame = self.history.since(frame), frame
        self._findings = None
        self._next_assessment = FIRST_ASSESSMENT_CHANGES
        self._known_lag, self._suspected_lag = None, 0
        self.table.trusted = False

    def trimmed(self) -> ExposureMonitor:
        """Return the monitor without spare room in its table; save it before the next frame."""
        table = ExposureTable.of(self.table.log_recorded, self.table.lag_frames, trusted=self.table.trusted)
        return replace(self, table=table)


def _certain_lag(found: ExposureFindings) -> int | None:
    return found.lag.certain_frames(found.evidence.recorded.cycle_frames)
