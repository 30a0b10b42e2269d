"""Detection of camera changes: new pairs of frames are predicted from earlier ones, and the errors are explained.

A quick fit to the earlier frames predicts the ratio of the two grey levels of every scene point in a new pair of
frames. If the camera is unchanged, the prediction errors are noise. If its vignette or its response has changed, they
depend on the radius or on the grey level within each pair. Changing light, from clouds or lamps, affects all points
of a pair equally: it is subtracted, and rarely mistaken for a change of the camera. Exposures that suddenly start to
lag are detected by :mod:`ospc.exposures.lag_change`.

Outliers among these errors raise a suspicion. Neighbouring frames soon reveal a change of the response; a change of
the vignette shows in frames further apart, between which scene points move radially. Every frame is then processed
for a while, and only pairs that begin after the suspicion count, because a pair that spans a change of the light is
inconclusive.

A quick fit leaves out glare, stray light and the like, whose errors also depend on grey level and radius. A change
that it proves is therefore tried again with the complete fit to the frames before it. If that proves nothing, it
remains the reference.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from ospc.estimation.fit import Fit
from ospc.exposures.table import ExposureTable
from ospc.methods.change_hypotheses import best_explanations, errors_of_pairs, explain, first_changed_frame
from ospc.methods.prediction_errors import PairErrors
from ospc.observations import Observations
from ospc.photometry.grey_range import FULL_RANGE, GreyRange
from ospc.settings.methods import (
    CALM_S,
    JUDGED_AGAIN_POINTS,
    JUDGED_S,
    LOCATED_S,
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
    """A change of the camera."""

    frame: int
    """Number of the first frame after the change (approximate)."""
    found: int
    """Number of the frame at which it was detected."""
    part: str
    """The part that changed: ``"response"``, ``"vignette"``, ``"response or vignette"`` or ``"exposures"``."""
    description: str
    """What changed, and by how much, as part of a sentence."""

    @property
    def text(self) -> str:
        """What changed, by how much and since which frame, as a sentence."""
        return f"since about frame {self.frame}, {self.description}"


@dataclass
class Baseline:
    """Usual errors of one kind of pairs, without a suspicion."""

    errors: list[float] = field(default_factory=list, repr=False)
    """Absolute errors of whole pairs."""
    effects: list[float] = field(default_factory=list, repr=False)
    """Errors within pairs."""
    outliers: list[tuple[int, bool]] = field(default_factory=list, repr=False)
    """Numbers of the second frames of the latest pairs, and whether they were outliers."""

    @property
    def error(self) -> float:
        """Usual absolute error of a whole pair, in ln."""
        return max(float(np.median(self.errors)), MIN_BASELINE_ERROR_LOG)

    def add(self, pair: PairErrors) -> None:
        """Compare a pair with the previous ones, and add it to them."""
        if len(self.errors) >= MIN_BASELINE_PAIRS:
            self.outliers = [*self.outliers, (pair.frame1, self.is_outlier(pair))][-RECENT_PAIRS:]
        self.errors = [*self.errors, abs(pair.error)][-MAX_BASELINE_PAIRS:]
        self.effects = [*self.effects, pair.effect][-MAX_BASELINE_PAIRS:]

    def is_outlier(self, pair: PairErrors) -> bool:
        """Whether the errors of a pair are unusual; between frames that are not neighbours, the light may change."""
        effect = max(float(np.median(self.effects)), MIN_BASELINE_ERROR_LOG)
        large_error = pair.consecutive and abs(pair.error) > OUTLIER_FACTOR * self.error
        return large_error or pair.effect > OUTLIER_FACTOR * effect

    @property
    def first_outlier(self) -> int | None:
        """Number of the second frame of the first recent outlier; None if there are few."""
        frames = [frame for frame, is_outlier in self.outliers if is_outlier]
        return frames[0] if len(frames) >= OUTLIER_PAIRS else None


@dataclass
class ChangeDetector:
    """Compares each new pair of frames with the prediction of the epoch's fit."""

    reference: Fit | None = None
    """The fit used for prediction, None before there is one."""
    grey_range: GreyRange = FULL_RANGE
    """The grey range to which it stretches grey levels."""
    complete_before: int = -1
    """Number of the frame before which the reference is a complete fit; negative if it is a quick fit."""
    neighbours: Baseline = field(default_factory=Baseline)
    """Baseline of pairs of neighbouring frames."""
    distant: Baseline = field(default_factory=Baseline)
    """Baseline of all other pairs."""
    pairs: list[PairErrors] = field(default_factory=list, repr=False)
    """Pairs of frames during a suspicion."""
    seen: list[Observations] = field(default_factory=list, repr=False)
    """Some of the observations in each of these pairs."""
    since: int | None = None
    """Number of the first frame that supports the suspicion; None without one."""
    suspected_at: int = 0
    """Number of the frame at which the latest suspicion was raised."""
    calm_until: int = 0
    """Number of the first frame that may raise another suspicion."""
    lag_frames: int = 0
    """Lag for which the errors were computed."""
    first_number: int = -1
    """Number of the first frame with a time stamp, negative for none."""
    first_stamp_s: float = 0.0
    """Its time stamp."""
    frames_per_s: float = MIN_FRAME_RATE
    """The limited frame rate since then."""

    def observe_time(self, number: int, stamp_s: float) -> None:
        """Update the frame rate with a frame's time stamp, which converts durations in seconds to frames."""
        if not math.isfinite(stamp_s):
            return
        if self.first_number < 0:
            self.first_number, self.first_stamp_s = number, stamp_s
            return
        passed_s = stamp_s - self.first_stamp_s
        rate = (number - self.first_number) / passed_s if passed_s > 0 else MIN_FRAME_RATE
        self.frames_per_s = min(max(rate, MIN_FRAME_RATE), MAX_FRAME_RATE)

    def set_reference(self, fit: Fit) -> None:
        """Predict with another quick fit from now on, unless the reference is a complete fit.

        The reference of a suspicion must not change.
        """
        if not self.pairs and self.complete_before < 0:
            self.reference = fit

    @property
    def is_suspicious(self) -> bool:
        """Whether there is a suspicion, so that every frame is processed."""
        return self.since is not None

    def observe(self, latest: Observations, exposures: ExposureTable) -> Change | None:
        """Process the observations of the latest pair, and return the camera change that they prove, if any.

        When a suspicion begins (:attr:`is_suspicious`), the reference should be replaced by a fit to all pairs so
        far. A change that is returned is only proven once :meth:`prove_again` returns it, too.
        """
        if self.reference is None or len(latest.starts) < MIN_PAIR_POINTS:
            return None
        pair = self._errors(latest, self.reference, exposures)
        if pair is None:
            return None
        if exposures.lag_frames != self.lag_frames:
            self.lag_frames = exposures.lag_frames
            self._forget_suspicion()
        if self.since is None:
            self._look_for_outliers(pair)
            return None
        first = max(self.since, pair.frame1 - self._frames(JUDGED_S))
        some = latest.of_points(slice(None, None, -(-len(latest.starts) // JUDGED_AGAIN_POINTS)))
        self.pairs = [old for old in (*self.pairs, pair) if old.frame0 >= first]
        self.seen = [old for old in (*self.seen, some) if old.frame[0] >= first]
        return self._explained_change(first, pair.frame1, self.reference, exposures)

    def prove_again(self, change: Change, fit: Fit, grey_range: GreyRange, exposures: ExposureTable) -> Change | None:
        """Compare the pairs again with the complete fit to the frames before a change, which becomes the reference.

        Return the change if they still prove one. If not, the suspicion continues, and its further changes need no
        other fit.
        """
        if self.since is None or self.complete_before >= self.since:
            return change
        self.reference, self.grey_range, self.complete_before = fit, grey_range, change.frame
        errors = (self._errors(seen, fit, exposures) for seen in self.seen)
        self.pairs = [pair for pair in errors if pair is not None]
        return self._explained_change(change.frame, change.found, fit, exposures)

    def located(self, change: Change, observed: Observations, exposures: ExposureTable) -> Change:
        """Return a proven change with its first frame, given the observations of all pairs that may show it.

        A suspicion may begin with outliers by chance, or when scene points first move enough to show the change.
        """
        assert self.reference is not None
        earlier = observed.of_points(observed.frame[observed.starts] < change.frame)  # later pairs were judged
        exposed = earlier.with_exposures(exposures).stretched(self.grey_range)
        pairs = [*errors_of_pairs(exposed, self.reference), *self.pairs]
        return replace(change, frame=first_changed_frame(pairs, self.reference, exposures, change.frame))

    def _errors(self, seen: Observations, fit: Fit, exposures: ExposureTable) -> PairErrors | None:
        """Return the errors of a pair; None if nothing of it is exposed."""
        exposed = seen.with_exposures(exposures).stretched(self.grey_range)
        return PairErrors.of(exposed, fit) if len(exposed) else None

    def _explained_change(self, first: int, frame: int, reference: Fit, exposures: ExposureTable) -> Change | None:
        """Return the change since a first frame that the pairs up to a frame prove; end the suspicion if it fades."""
        found = explain(self.pairs, reference, exposures, self.neighbours.error, self._frames(MIN_SPAN_S))
        if found is None:
            self._end_suspicion(frame, reference)
            return None
        part, text = found
        return Change(first, frame, part, text)

    def _look_for_outliers(self, pair: PairErrors) -> None:
        baseline = self.neighbours if pair.consecutive else self.distant
        baseline.add(pair)
        first = baseline.first_outlier
        if first is not None and len(self.neighbours.errors) >= MIN_BASELINE_PAIRS and pair.frame1 >= self.calm_until:
            self._forget_suspicion()
            self.since, self.suspected_at = first, pair.frame1

    def _end_suspicion(self, frame: int, reference: Fit) -> None:
        """End a suspicion that has lasted too long or is no longer supported."""
        latest = [pair for pair in self.pairs if pair.consecutive][-WATCHED_PAIRS:]
        if frame > self.suspected_at + self._frames(MAX_SUSPICION_S):
            self.calm_until = frame + self._frames(CALM_S)
            self._forget_suspicion()
        elif len(latest) == WATCHED_PAIRS:
            many_outliers = sum(map(self.neighbours.is_outlier, latest)) >= MIN_OUTLIER_SHARE * len(latest)
            if not many_outliers and best_explanations(self.pairs, reference)[0].sigmas < MIN_HALF_SIGMAS:
                self._forget_suspicion()

    def _forget_suspicion(self) -> None:
        """Forget a suspicion, and the usual errors if they are those of an earlier reference."""
        if self.since is not None and self.complete_before >= self.since:
            self.neighbours, self.distant = Baseline(), Baseline()
        self.since = None
        self.pairs, self.seen = [], []
        self.neighbours.outliers, self.distant.outliers = [], []

    def first_searched(self, change: Change) -> int:
        """Return the number of the first frame that may be the first one after a change."""
        return max(0, change.frame - self._frames(LOCATED_S))

    def _frames(self, duration_s: float) -> int:
        return round(duration_s * self.frames_per_s)
