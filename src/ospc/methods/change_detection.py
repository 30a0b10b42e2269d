"""Has the camera changed? New pairs of frames are predicted by what was known before, and the errors are explained.

A fit from the beginning of an epoch predicts the ratio of the two grey levels of every scene point in a new pair of
frames. If the camera is the same, the prediction errors are noise. If its vignette or its response is another, they
depend on the radius or on the grey level within each pair. If exposures are suddenly written late, the errors of
whole pairs are those of other exposures. Light that changes, by clouds or lamps, changes all points of a pair alike:
it is subtracted, and seldom mistaken for a change of the camera.

Errors that are larger than usual raise a suspicion. From then on every frame is processed for a while, and only pairs
that begin after the suspicion count: in a pair that spans a change of the light nothing can be told.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ospc.arrays import FloatArray
from ospc.estimation.fit import Fit
from ospc.exposures.table import ExposureTable
from ospc.methods.prediction_errors import PARTS, ExplainedChange, PairErrors
from ospc.observations import Observations

FEWEST_POINTS = 40
"""Scene points of a pair below which its registration is not trusted."""

MOST_USUAL = 480
"""Pairs of neighbours whose errors say what is usual: a minute and a half of film at 20 frames/s."""

FEWEST_USUAL = 12
"""Pairs of neighbours before anything is unusual."""

RECENT_NEIGHBOURS, SURPRISING_NEIGHBOURS = 8, 3
"""Of the latest so many pairs of neighbours, so many must be surprising to raise a suspicion."""

SURPRISE = 4.0
"""How many times the usual error is a surprise; three in eight pairs exceed it when a lamp is switched, too."""

USUAL_FLOOR_LOG = 0.001
"""Least usual error, in ln: registration leaves as much."""

SHORTEST_WATCH_FRAMES, LONGEST_WATCH_FRAMES = 64, 192
"""Frames for which a suspicion is followed: light that changes is often over before the first, which at 20 frames/s
is after three seconds."""

CALM_FRAMES = 192
"""Frames without another suspicion after one that was followed to the end."""

WATCHED_NEIGHBOURS, MIN_SURPRISING_SHARE = 32, 0.25
"""A suspicion ends early where fewer of the latest so many pairs of neighbours are surprising: the light changed."""

MOST_PAIRS = 256
"""Latest pairs remembered while a suspicion is followed."""

FEWEST_PAIRS = 12
"""Pairs of each half of those watched by which a change is judged: what happens once is no change."""

MIN_EFFECT_LOG = 0.04
"""Smallest change, in ln of irradiance, that counts: a refocused lens changes the corners by more, drift by less."""

MIN_SIGMAS, MIN_SIGMAS_OF_HALF = 8.5, 4.5
"""Standard deviations, by the scatter between pairs, that a change must exceed in all pairs and in each half."""

SYSTEMATIC_LOG = 0.006
"""Standard deviation, in ln, by which registration is wrong in ways that pairs have in common."""

ALIKE_GAIN = 0.9
"""Share of the gain of one explanation from which on the other is as good, and both are named."""

MAJORITY = 0.8
"""Share of the pairs in each half that a change must explain: a few wrong registrations prove nothing."""

TELLING = 3.0
"""How many times the usual error a change must make of a pair for the pair to tell."""

FEWEST_TELLING = 6
"""Telling pairs needed in each half."""

LAGS = (-3, -2, -1, 1, 2, 3)
"""Changes of the lag that are tried, in frames."""

LIGHT_SLOPE = -0.75
"""Slope of the error against the change of exposure from which on light that the exposure follows explains it: an
exposure control that keeps brightness constant shows a slope of −1."""

MIN_SLOPE = 0.15
"""Smallest change of that slope by another response."""

MIN_SLOPE_ERROR_LOG = 0.008
"""Median error of neighbours, in ln, below which the slope is not judged: clouds change light by less a frame."""


@dataclass(frozen=True)
class Change:
    """A change of the camera.

    Attributes
    ----------
    frame
        Number of the first frame after it, as nearly as it can be told.
    found
        Number of the frame at which it was found.
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
    usual_errors, usual_effects
        Absolute errors of whole pairs of neighbours, and errors within them, while nothing was suspected.
    surprises
        Numbers of the first frames of the latest pairs of neighbours, and whether they were surprising.
    pairs
        Pairs of frames since the suspicion.
    since
        Number of the first frame of the suspicion; None while there is none.
    calm_until
        Number of the frame from which on there may be another suspicion.
    lag_frames
        Lag that the errors hold for.
    """

    reference: Fit | None = None
    usual_errors: list[float] = field(default_factory=list, repr=False)
    usual_effects: list[float] = field(default_factory=list, repr=False)
    surprises: list[tuple[int, bool]] = field(default_factory=list, repr=False)
    pairs: list[PairErrors] = field(default_factory=list, repr=False)
    since: int | None = None
    calm_until: int = 0
    lag_frames: int = 0

    def rely_on(self, fit: Fit) -> None:
        """Predict by another fit from now on."""
        if self.reference is not None and len(self.reference.parameters) == len(fit.parameters):
            step = fit.parameters - self.reference.parameters
            self.pairs = [pair.after_update(step) for pair in self.pairs]
        else:
            self.pairs = []
        self.reference = fit

    @property
    def is_watching(self) -> bool:
        """Whether there is a suspicion, so that every frame is to be processed."""
        return self.since is not None

    def observe(self, latest: Observations, exposures: ExposureTable) -> Change | None:
        """Take the observations of the latest pair, and return the change of the camera that they suggest, if any.

        It is to be confirmed, :meth:`suggested`, after a fit to everything, the latest pairs included: a camera that
        is the same has one fit that predicts all of them, however new the grey levels and radii are that they show.
        """
        if self.reference is None or len(latest.starts) < FEWEST_POINTS:
            return None
        exposed = latest.with_exposures(exposures)
        if not len(exposed):
            return None
        if exposures.lag_frames != self.lag_frames:
            self.lag_frames, self.since, self.pairs, self.surprises = exposures.lag_frames, None, [], []
        pair = PairErrors.of(exposed, self.reference)
        if self.since is None:
            self._look_for_surprises(pair)
            return None
        if pair.frame0 >= self.since:
            self.pairs = [*self.pairs, pair][-MOST_PAIRS:]
        change = self.suggested(exposures)
        if change is None:
            self._end_suspicion(pair.frame1)
        return change

    def suggested(self, exposures: ExposureTable) -> Change | None:
        """Return the change of the camera that the pairs since the suspicion suggest, if any."""
        if self.since is None or not self.pairs or self.pairs[-1].frame1 < self.since + SHORTEST_WATCH_FRAMES:
            return None
        if len(self.pairs) < 2 * FEWEST_PAIRS:
            return None
        half = len(self.pairs) // 2
        halves = (self.pairs[:half], self.pairs[half:])
        return self._late_exposures(halves, exposures) or self._slope(halves, exposures) or self._curves(halves)

    def _look_for_surprises(self, pair: PairErrors) -> None:
        if not pair.of_neighbours:
            return
        if len(self.usual_errors) >= FEWEST_USUAL:
            self.surprises = [*self.surprises, (pair.frame0, self._surprises(pair))][-RECENT_NEIGHBOURS:]
        self.usual_errors = [*self.usual_errors, abs(pair.error)][-MOST_USUAL:]
        self.usual_effects = [*self.usual_effects, pair.effect][-MOST_USUAL:]
        frames = [frame for frame, surprising in self.surprises if surprising]
        if len(frames) >= SURPRISING_NEIGHBOURS and pair.frame1 >= self.calm_until:
            self.since, self.surprises = frames[0] + 1, []

    def _surprises(self, pair: PairErrors) -> bool:
        usual_effect = max(float(np.median(self.usual_effects)), USUAL_FLOOR_LOG)
        return abs(pair.error) > SURPRISE * self._usual_error or pair.effect > SURPRISE * usual_effect

    def _end_suspicion(self, frame: int) -> None:
        """End a suspicion that has lasted too long, or that nothing supports any more."""
        assert self.since is not None
        latest = [pair for pair in self.pairs if pair.of_neighbours][-WATCHED_NEIGHBOURS:]
        if frame > self.since + LONGEST_WATCH_FRAMES:
            self.since, self.pairs, self.calm_until = None, [], frame + CALM_FRAMES
        elif len(latest) == WATCHED_NEIGHBOURS:
            surprising = sum(self._surprises(pair) for pair in latest) >= MIN_SURPRISING_SHARE * len(latest)
            if not surprising and self._explained(self.pairs).sigmas < MIN_SIGMAS_OF_HALF:
                self.since, self.pairs = None, []

    def _explained(self, pairs: list[PairErrors]) -> ExplainedChange:
        """Return the change of one part of the camera that explains pairs best."""
        assert self.reference is not None
        parts = (ExplainedChange.of(pairs, self.reference, part, SYSTEMATIC_LOG) for part in PARTS)
        return max(parts, key=lambda explained: explained.gain)

    @property
    def _usual_error(self) -> float:
        return max(float(np.median(self.usual_errors)), USUAL_FLOOR_LOG)

    def _curves(self, halves: tuple[list[PairErrors], list[PairErrors]]) -> Change | None:
        """Return a change of response or vignette: errors that depend on the grey level or the radius."""
        if self.reference is None or self.since is None:
            return None
        everything = [*halves[0], *halves[1]]
        wholes = [ExplainedChange.of(everything, self.reference, part, SYSTEMATIC_LOG) for part in PARTS]
        whole = max(wholes, key=lambda explained: explained.gain)
        if abs(whole.effect) < MIN_EFFECT_LOG or whole.sigmas < MIN_SIGMAS:
            return None
        parts = [ExplainedChange.of(half, self.reference, whole.part, SYSTEMATIC_LOG) for half in halves]
        if min(half.sigmas for half in parts) < MIN_SIGMAS_OF_HALF:
            return None
        # What one half shows must explain the other.
        for half, other in zip(parts, reversed(halves), strict=True):
            gains = np.array([pair.gain(half.change) for pair in other])
            if gains.sum() <= 0 or np.mean(gains > 0) < MAJORITY:
                return None
        part = " or ".join(PARTS) if min(each.gain for each in wholes) > ALIKE_GAIN * whole.gain else whole.part
        text = f"the {part} changed at about frame {self.since}, by {np.expm1(whole.effect):+.0%}"
        return Change(self.since, everything[-1].frame1, part, text)

    def _late_exposures(
        self, halves: tuple[list[PairErrors], list[PairErrors]], exposures: ExposureTable
    ) -> Change | None:
        """Return a change of the lag: the errors of whole pairs are those of other exposures."""
        if self.since is None:
            return None
        best = None
        for lag in LAGS:
            other = exposures.with_lag(exposures.lag_frames + lag)
            expected = [_log_ratios(half, other) - _log_ratios(half, exposures) for half in halves]
            left = self._left_by(halves, expected)
            if left is not None and (best is None or left < best[0]):
                best = left, lag
        if best is None:
            return None
        lag = best[1]
        words = f"{abs(lag)} frame{'' if abs(lag) == 1 else 's'} {'later' if lag > 0 else 'earlier'}"
        text = f"the exposures are written {words} than before, since about frame {self.since}"
        return Change(self.since, halves[1][-1].frame1, "exposures", text)

    def _slope(self, halves: tuple[list[PairErrors], list[PairErrors]], exposures: ExposureTable) -> Change | None:
        """Return a change of the response: brightness follows the exposure more or less than before."""
        if self.since is None:
            return None
        steps = [_log_ratios(half, exposures) for half in halves]
        slopes = [_median_slope(half, step) for half, step in zip(halves, steps, strict=True)]
        if any(not (slope > MIN_SLOPE or LIGHT_SLOPE < slope < -MIN_SLOPE) for slope in slopes):
            return None
        errors = np.abs([pair.error for half in halves for pair in half if pair.of_neighbours])
        # What one half shows must explain the other.
        expected = [slope * step for slope, step in zip(reversed(slopes), steps, strict=True)]
        if len(errors) == 0 or np.median(errors) < MIN_SLOPE_ERROR_LOG or self._left_by(halves, expected) is None:
            return None
        text = (
            f"the response changed, or a gain that the exposures do not hold, since about frame {self.since}: "
            f"brightness follows the exposure by {np.mean(slopes):+.0%}"
        )
        return Change(self.since, halves[1][-1].frame1, "response", text)

    def _left_by(self, halves: tuple[list[PairErrors], list[PairErrors]], expected: list[FloatArray]) -> float | None:
        """Return the median error that is left of telling pairs; None unless most in each half are explained."""
        least = TELLING * self._usual_error
        left = []
        for half, change in zip(halves, expected, strict=True):
            error = np.array([pair.error for pair in half])
            telling = np.isfinite(change) & (np.abs(change) > least)
            better = np.abs(error - change)[telling] < np.abs(error)[telling] / 2
            if np.count_nonzero(telling) < FEWEST_TELLING or better.mean() < MAJORITY:
                return None
            left.append(np.abs(error - change)[telling])
        return float(np.median(np.concatenate(left)))


def _log_ratios(pairs: list[PairErrors], exposures: ExposureTable) -> FloatArray:
    """Return ln of the exposure of each pair's second frame over that of its first, NaN where one is unknown."""
    frames = np.array([(pair.frame0, pair.frame1) for pair in pairs])
    return np.asarray(np.diff(exposures.log_exposure_of(frames), axis=1)[:, 0])


def _median_slope(pairs: list[PairErrors], step: FloatArray) -> float:
    """Return the median of error over change of exposure, weighted by the change; 0 where nothing changes."""
    weight = np.where(np.isfinite(step), np.abs(step), 0.0)
    moving = weight > 0
    if not moving.any():
        return 0.0
    slope = np.array([pair.error for pair in pairs])[moving] / step[moving]
    order = np.argsort(slope)
    total = np.cumsum(weight[moving][order])
    return float(slope[order[np.searchsorted(total, total[-1] / 2)]])
