"""The exposures of a run, and what the images say of them, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray, ImageSize
from ospc.correspondence.thumbnail import Thumbnail
from ospc.errors import OspcError
from ospc.exposures.brightness import BrightnessChange
from ospc.exposures.evidence import ComparedAhead, EvidenceState, ExposureEvidence
from ospc.exposures.findings import ExposureFindings, assess_exposures
from ospc.exposures.lag_change import LagChange, lag_change
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
class AssessmentState:
    """All that an :class:`ExposureAssessment` knows.

    ``log_exposure`` is ln of the exposures as written, shape (frames,), corrected by ``lag_frames`` during the run,
    and ``trusted`` where the images were found to agree with them. ``evidence`` is None before the first usable
    frame. The exposures are assessed again once there are ``next_assessment`` changes of brightness. ``known_lag`` is
    the latest lag that was certain, None where none was; at the latest look, exposures seemed to be written
    ``suspected_lag`` frames later than that.
    """

    log_exposure: FloatArray
    lag_frames: int
    trusted: bool
    evidence: EvidenceState | None
    next_assessment: int
    known_lag: int | None
    suspected_lag: int


class ExposureAssessment:
    """Keeps the exposures of a run, and judges them by the changes of brightness.

    ``choice`` says what to do about a lag; SettingError if it is not a :data:`~ospc.exposures.lag_choice.LagChoice`.
    ``table`` holds the exposures written beside the frames so far, and ``evidence`` the changes of brightness between
    consecutive frames; it is None before the first usable frame.
    """

    def __init__(self, choice: LagChoice) -> None:
        self.choice: LagChoice = checked_lag_choice(choice)
        self.table = ExposureTable(self.choice if isinstance(self.choice, int) else 0)
        self.evidence: ExposureEvidence | None = None
        self._since = 0
        self._next_assessment = FIRST_ASSESSMENT_CHANGES
        self._known_lag: int | None = None
        self._suspected_lag = 0
        self._findings: tuple[tuple[int, int], ExposureFindings] | None = None

    def begin(self, size: ImageSize) -> None:
        """Expect frames of a width and height in pixels."""
        self.evidence = ExposureEvidence(size)

    def take_back(self, number: int) -> None:
        """Forget the exposures written beside the frames from a number on."""
        self.table = self.table.until(number)

    def observe(self, frame: Thumbnail, ahead: ComparedAhead | None = None) -> BrightnessChange | None:
        """Compare a frame with the one before, unless that was done ahead; return what that gave."""
        assert self.evidence is not None
        return self.evidence.observe(frame, ahead)

    def reassess(self) -> None:
        """Judge the exposures again if there is much more evidence than the last time."""
        if self.evidence is None or self.evidence.observed < self._next_assessment:
            return
        if not leaves_frames(self.choice, len(self.table) - self._since):
            return
        self._next_assessment = int(ASSESSMENT_GROWTH * self.evidence.observed)
        found = self.findings()
        self.table.lag_frames = found.corrected_frames
        certain = found.lag.correction(found.course.cycle_frames)
        self.table.trusted = certain is not None and not found.warnings
        if certain is not None:  # a change that makes the lag uncertain is still to be found
            self._known_lag = certain

    def findings(self) -> ExposureFindings:
        """Return what the images say about the exposures so far; OspcError if no frame could be read."""
        if self.evidence is None:
            raise OspcError("no frame could be used, so nothing is known about the exposures")
        key = (len(self.table), len(self.evidence))
        if self._findings is None or self._findings[0] != key:
            self._findings = (key, self._assessed(self.evidence, self.table.written))
        return self._findings[1]

    @property
    def corrected(self) -> ExposureTable:
        """The exposures, with the lag corrected by what is known now."""
        return replace(self.table, lag_frames=self.findings().corrected_frames)

    def change_of_lag(self, *, explains: bool) -> LagChange | None:
        """Return a change of the lag, looked for at times, if one look proves what the one before made suspect.

        One look is enough where the change ``explains`` another change of the camera.
        """
        if self.evidence is None or self._known_lag is None:
            return None
        every = SUSPECTED_LAG_CHECK_INTERVAL_CHANGES if self._suspected_lag else LAG_CHECK_INTERVAL_CHANGES
        if not explains and len(self.evidence) % every:
            return None
        with one_blas_thread():
            found = lag_change(self.evidence.changes, self.table.written, self._known_lag)
        suspected, self._suspected_lag = self._suspected_lag, 0 if found is None else found.later_frames
        if found is None or not found.proven or not (explains or suspected * found.later_frames > 0):
            return None
        if self.choice == "auto":
            self.table.lag_frames = self._known_lag + found.later_frames
        return found

    @property
    def lag_is_open(self) -> bool:
        """Whether more changes of brightness may still settle that exposures belong to their frames, or to which."""
        if self.choice == "trusted":
            return False
        few = self.evidence is None or len(self.evidence) < LAG_SEARCH_CHANGES
        return self._suspected_lag != 0 or (few and not self.table.trusted)

    def wants(self, number: int) -> bool:
        """Return whether a frame can help to settle the lag: the exposures written around it change."""
        recent = self.table.written[max(0, number - EXPOSURE_CHANGE_FRAMES) : number + 1]
        return self.lag_is_open and float(np.nanmax(recent) - np.nanmin(recent)) > MIN_EXPOSURE_CHANGE_LOG

    def split(self, frame: int) -> tuple[ExposureFindings, ExposureTable]:
        """Go on with what came from a frame on; return what is known of those before, and their exposures."""
        assert self.evidence is not None
        later = self.evidence.split(frame)
        found = self._assessed(self.evidence, self.table.written[:frame])
        before = replace(self.table.until(frame), lag_frames=found.corrected_frames)
        self.evidence, self._since, self._findings = later, frame, None
        self._next_assessment, self._known_lag, self._suspected_lag = FIRST_ASSESSMENT_CHANGES, None, 0
        self.table.trusted = False
        return found, before

    def _assessed(self, evidence: ExposureEvidence, log_exposure: FloatArray) -> ExposureFindings:
        # Its matrices are small: further threads of the linear algebra would only wait for each other.
        with one_blas_thread():
            return assess_exposures(evidence, log_exposure, self.choice, since=self._since)

    def state(self) -> AssessmentState:
        """Return all that is known."""
        return AssessmentState(
            self.table.written,
            self.table.lag_frames,
            self.table.trusted,
            None if self.evidence is None else self.evidence.state(),
            self._next_assessment,
            self._known_lag,
            self._suspected_lag,
        )

    def restore(self, state: AssessmentState, size: ImageSize, since: int) -> None:
        """Go on from a state of frames of a size, whose epoch began with a frame."""
        self.table = ExposureTable.of(state.log_exposure, state.lag_frames, trusted=state.trusted)
        self.evidence = None if state.evidence is None else ExposureEvidence.from_state(size, state.evidence)
        self._next_assessment, self._since = state.next_assessment, since
        self._known_lag, self._suspected_lag = state.known_lag, state.suspected_lag
