"""Has the camera changed? New pairs of frames are predicted by what was known before, and the errors are explained.

A fit from the beginning of an epoch predicts the ratio of the two grey levels of every scene point in a new pair of
frames. If the camera is the same, the prediction errors are noise. If its vignette or its response is another, they
depend on the radius or on the grey level within each pair. Light that changes, by clouds or lamps, changes all points
of a pair alike: it is subtracted, and seldom mistaken for a change of the camera. Exposures that are suddenly written
late are found by :mod:`ospc.exposures.lag_change`.

Outliers among these errors raise a suspicion. From then on every frame is processed for a while, and only pairs that
begin after the suspicion count: in a pair that spans a change of the light nothing can be told.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ospc.estimation.fit import Fit
from ospc.exposures.table import ExposureTable
from ospc.methods.change_hypotheses import best_explanations, explain
from ospc.methods.prediction_errors import PairErrors
from ospc.observations import Observations
from ospc.settings.methods import (
    CALM_S,
    JUDGED_S,
    MAX_BASELINE_PAIRS,
    MAX_FRAME_RATE,
    MAX_SUSPICION_S,
    MIN_BASELINE_ERROR_LOG,
    MIN_BASELINE_PAIRS,
    MIN_FRAME_RATE,
    MIN_HALF_SIGMAS,
    MIN_OUTLIER_SHARE,
    MIN_PAIR_POINTS,
    MIN_SPAN_S,
    OUTLIER_FACTOR,
    OUTLIER_PAIRS,
    RECENT_PAIRS,
    WATCHED_PAIRS,
)


@dataclass(frozen=True)
class Change:
    """A change of the camera.

    Attributes
    ----------
    frame, found
        Numbers of the first frame after it, as nearly as it can be told, and of that at which it was found.
    part
        What changed: ``"response"``, ``"vignette"``, ``"response or vignette"`` or ``"exposures"``.
    text
        What changed, by how much and since which frame, as one sentence.
    """

    frame: int
    found: int
    part: str
    text: str


@dataclass
class ChangeDetector:
    """Compares each new pair of frames with what the epoch's fit predicts.

    Attributes
    ----------
    reference
        The fit that predicts; None before there is one.
    baseline_errors, baseline_effects
        Absolute errors of whole pairs of neighbours, and errors within them, while nothing was suspected.
    outliers
        Numbers of the first frames of the latest pairs of neighbours, and whether they were outliers.
    pairs, since
        Pairs of frames since the suspicion, and the number of its first frame; None while there is none.
    calm_until
        Number of the frame from which on there may be another suspicion.
    lag_frames
        Lag that the errors hold for.
    first_number, first_stamp_s, frames_per_s
        Number and time stamp of the first frame, none if negative, and the rate since then, within limits.
    """

    reference: Fit | None = None
    baseline_errors: list[float] = field(default_factory=list, repr=False)
    baseline_effects: list[float] = field(default_factory=list, repr=False)
    outliers: list[tuple[int, bool]] = field(default_factory=list, repr=False)
    pairs: list[PairErrors] = field(default_factory=list, repr=False)
    since: int | None = None
    calm_until: int = 0
    lag_frames: int = 0
    first_number: int = -1
    first_stamp_s: float = 0.0
    frames_per_s: float = MIN_FRAME_RATE

    def observe_time(self, number: int, stamp_s: float) -> None:
        """Take the time stamp of a frame: light changes with time, however many frames that takes."""
        if not math.isfinite(stamp_s):
            return
        if self.first_number < 0:
            self.first_number, self.first_stamp_s = number, stamp_s
            return
        passed_s = stamp_s - self.first_stamp_s
        rate = (number - self.first_number) / passed_s if passed_s > 0 else MIN_FRAME_RATE
        self.frames_per_s = min(max(rate, MIN_FRAME_RATE), MAX_FRAME_RATE)

    def set_reference(self, fit: Fit) -> None:
        """Predict by another fit from now on, unless a suspicion is followed: what it rests on must stay the same."""
        if not self.pairs:
            self.reference = fit

    @property
    def is_suspicious(self) -> bool:
        """Whether there is a suspicion, so that every frame is to be processed."""
        return self.since is not None

    def observe(self, latest: Observations, exposures: ExposureTable) -> Change | None:
        """Take the observations of the latest pair, and return the change of the camera that they prove, if any.

        When a suspicion begins, :attr:`is_suspicious`, the reference is best replaced by a fit to everything so far.
        """
        if self.reference is None or len(latest.starts) < MIN_PAIR_POINTS:
            return None
        if self.since is None and latest.frame[1] != latest.frame[0] + 1:
            return None  # only neighbours raise a suspicion
        exposed = latest.with_exposures(exposures)
        if not len(exposed):
            return None
        if exposures.lag_frames != self.lag_frames:
            self.lag_frames, self.since, self.pairs, self.outliers = exposures.lag_frames, None, [], []
        pair = PairErrors.of(exposed, self.reference)
        if self.since is None:
            self._look_for_outliers(pair)
            return None
        first = max(self.since, pair.frame1 - self._frames(JUDGED_S))
        self.pairs = [old for old in (*self.pairs, pair) if old.frame0 >= first]
        found = explain(self.pairs, self.reference, exposures, self._baseline_error, self._frames(MIN_SPAN_S))
        if found is None:
            self._end_suspicion(pair.frame1, self.since, self.reference)
            return None
        part, text = found
        first = min(old.frame0 for old in self.pairs)
        return Change(first, self.pairs[-1].frame1, part, f"{text}, since about frame {first}")

    def _look_for_outliers(self, pair: PairErrors) -> None:
        if len(self.baseline_errors) >= MIN_BASELINE_PAIRS:
            self.outliers = [*self.outliers, (pair.frame0, self._is_outlier(pair))][-RECENT_PAIRS:]
        self.baseline_errors = [*self.baseline_errors, abs(pair.error)][-MAX_BASELINE_PAIRS:]
        self.baseline_effects = [*self.baseline_effects, pair.effect][-MAX_BASELINE_PAIRS:]
        frames = [frame for frame, is_outlier in self.outliers if is_outlier]
        if len(frames) >= OUTLIER_PAIRS and pair.frame1 >= self.calm_until:
            self.since, self.outliers = frames[0] + 1, []

    def _is_outlier(self, pair: PairErrors) -> bool:
        baseline_effect = max(float(np.median(self.baseline_effects)), MIN_BASELINE_ERROR_LOG)
        large_error = abs(pair.error) > OUTLIER_FACTOR * self._baseline_error
        return large_error or pair.effect > OUTLIER_FACTOR * baseline_effect

    def _end_suspicion(self, frame: int, since: int, reference: Fit) -> None:
        """End a suspicion that has lasted too long, or that nothing supports any more."""
        latest = [pair for pair in self.pairs if pair.consecutive][-WATCHED_PAIRS:]
        if frame > since + self._frames(MAX_SUSPICION_S):
            self.since, self.pairs, self.calm_until = None, [], frame + self._frames(CALM_S)
        elif len(latest) == WATCHED_PAIRS:
            many_outliers = sum(self._is_outlier(pair) for pair in latest) >= MIN_OUTLIER_SHARE * len(latest)
            if not many_outliers and best_explanations(self.pairs, reference)[0].sigmas < MIN_HALF_SIGMAS:
                self.since, self.pairs = None, []

    def _frames(self, duration_s: float) -> int:
        return round(duration_s * self.frames_per_s)

    @property
    def _baseline_error(self) -> float:
        return max(float(np.median(self.baseline_errors)), MIN_BASELINE_ERROR_LOG)
