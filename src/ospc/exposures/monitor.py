"""The exposures of a run, checked against the images while the frames come in."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.exposures.brightness_history import BrightnessHistory
from ospc.exposures.findings import ExposureFindings, assess_exposures
from ospc.exposures.lag_change import LagChange, detect_lag_change
from ospc.exposures.lag_choice import LagChoice, checked_lag_choice, leaves_frames
from ospc.exposures.table import ExposureTable
from ospc.library_threads import one_blas_thread
from ospc.settings.exposures import (
    ASSESSMENT_GROWTH,
    EXPOSURE_CHANGE_FRAMES,
    FIRST_ASSESSMENT_CHANGES,
    LAG_CHECK_INTERVAL_CHANGES,
    LAG_SEARCH_CHANGES,
    MIN_EXPOSURE_CHANGE_LOG,
    SUSPECTED_LAG_CHECK_INTERVAL_CHANGES,
)


@dataclass(frozen=True)
class ExposureMonitorState:
    """All that an :class:`ExposureMonitor` knows.

    Attributes
    ----------
    log_exposure
        ln of the exposures as written, in milliseconds, shape (frames,).
    lag_frames, trusted
        The lag by which they are corrected during the run, and whether the images were found to agree with them.
    history
        The changes of brightness.
    next_assessment
        Number of changes of brightness at which the exposures are assessed again.
    known_lag
        The latest lag that was certain, None where none was.
    suspected_lag
        By how many frames later than that the exposures seemed to be written at the latest check; 0 for no doubt.
    """

    log_exposure: FloatArray
    lag_frames: int
    trusted: bool
    history: BrightnessHistory
    next_assessment: int
    known_lag: int | None
    suspected_lag: int


class ExposureMonitor:
    """Keeps the exposures of a run, and checks them against the changes of brightness.

    Parameters
    ----------
    choice
        What to do about a lag; SettingError if it is not a :data:`~ospc.exposures.lag_choice.LagChoice`.

    Attributes
    ----------
    table
        The exposures written beside the frames so far.
    history
        The changes of brightness between consecutive frames of this epoch.
    """

    def __init__(self, choice: LagChoice) -> None:
        self.choice: LagChoice = checked_lag_choice(choice)
        self.table = ExposureTable(self.choice if isinstance(self.choice, int) else 0)
        self.history = BrightnessHistory()
        self._first_frame = 0
        self._next_assessment = FIRST_ASSESSMENT_CHANGES
        self._known_lag: int | None = None
        self._suspected_lag = 0
        self._findings: tuple[tuple[int, int], ExposureFindings] | None = None

    def assess_if_due(self) -> None:
        """Assess the exposures again if many more changes of brightness are known than the last time."""
        if self.history.observed < self._next_assessment:
            return
        if not leaves_frames(self.choice, len(self.table) - self._first_frame):
            return
        self._next_assessment = int(ASSESSMENT_GROWTH * self.history.observed)
        found = self.findings()
        self.table.lag_frames = found.corrected_frames
        certain = found.lag.correction(found.course.cycle_frames)
        self.table.trusted = certain is not None and not found.warnings
        if certain is not None:  # a change that makes the lag uncertain is still to be found
            self._known_lag = certain

    def findings(self) -> ExposureFindings:
        """Return what the images say about the exposures so far."""
        key = (len(self.table), len(self.history))
        if self._findings is None or self._findings[0] != key:
            self._findings = (key, self._assess(self.table.written))
        return self._findings[1]

    @property
    def corrected_table(self) -> ExposureTable:
        """The exposures, with the lag corrected by what is known now."""
        return replace(self.table, lag_frames=self.findings().corrected_frames)

    def detect_lag_change(self, *, camera_changed: bool) -> LagChange | None:
        """Return a change of the lag if it is proven, and the check before made it suspect.

        It is checked at intervals. Where another change of the camera was found, which a change of the lag may
        explain, it is checked at once, and this one check is enough.
        """
        if self._known_lag is None:
            return None
        interval = SUSPECTED_LAG_CHECK_INTERVAL_CHANGES if self._suspected_lag else LAG_CHECK_INTERVAL_CHANGES
        if not camera_changed and len(self.history) % interval:
            return None
        with one_blas_thread():
            found = detect_lag_change(self.history.changes, self.table.written, self._known_lag)
        suspected, self._suspected_lag = self._suspected_lag, 0 if found is None else found.later_frames
        if found is None or not found.proven or not (camera_changed or suspected * found.later_frames > 0):
            return None
        if self.choice == "auto":
            self.table.lag_frames = self._known_lag + found.later_frames
        return found

    @property
    def lag_is_uncertain(self) -> bool:
        """Whether more changes of brightness may still show to which frames the exposures belong."""
        if self.choice == "trusted":
            return False
        return self._suspected_lag != 0 or (len(self.history) < LAG_SEARCH_CHANGES and not self.table.trusted)

    def needs_comparison(self, number: int) -> bool:
        """Return whether comparing a frame with the one before helps to determine the lag: exposures change there."""
        recent = self.table.written[max(0, number - EXPOSURE_CHANGE_FRAMES) : number + 1]
        return self.lag_is_uncertain and float(np.nanmax(recent) - np.nanmin(recent)) > MIN_EXPOSURE_CHANGE_LOG

    def split(self, frame: int) -> tuple[ExposureFindings, ExposureTable]:
        """Go on with what came from a frame on; return what is known of those before, and their exposures."""
        later = self.history.split(frame)
        found = self._assess(self.table.written[:frame])
        before = replace(self.table.until(frame), lag_frames=found.corrected_frames)
        self.history, self._first_frame, self._findings = later, frame, None
        self._next_assessment, self._known_lag, self._suspected_lag = FIRST_ASSESSMENT_CHANGES, None, 0
        self.table.trusted = False
        return found, before

    def _assess(self, log_exposure: FloatArray) -> ExposureFindings:
        # Its matrices are small: further threads of the linear algebra would only wait for each other.
        with one_blas_thread():
            return assess_exposures(self.history.changes, log_exposure, self.choice, first_frame=self._first_frame)

    def state(self) -> ExposureMonitorState:
        """Return all that is known; to be taken before the next frame."""
        return ExposureMonitorState(
            log_exposure=self.table.written,
            lag_frames=self.table.lag_frames,
            trusted=self.table.trusted,
            history=self.history,
            next_assessment=self._next_assessment,
            known_lag=self._known_lag,
            suspected_lag=self._suspected_lag,
        )

    def restore(self, state: ExposureMonitorState, first_frame: int) -> None:
        """Go on from a state whose epoch began with a frame."""
        self.table = ExposureTable.of(state.log_exposure, state.lag_frames, trusted=state.trusted)
        self.history, self._first_frame = state.history, first_frame
        self._next_assessment = state.next_assessment
        self._known_lag, self._suspected_lag = state.known_lag, state.suspected_lag
