"""The camera change, of response or vignette, that explains the errors of pairs of frames, and its first frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ospc.arrays import BoolArray, FloatArray, IntArray
from ospc.estimation.fit import Fit
from ospc.exposures.table import ExposureTable
from ospc.methods.prediction_errors import PARTS, ExplainedChange, PairErrors
from ospc.numerics.robust import weighted_median
from ospc.observations import ExposedObservations
from ospc.settings.methods import (
    ALIKE_RATIO,
    CLEARLY_WORSE_FACTOR,
    COMPARABLE_RATIO,
    LIGHT_SLOPE,
    MAJORITY,
    MAX_STATED_EFFECT_LOG,
    MIN_BASELINE_ERROR_LOG,
    MIN_CHANGE_SHARE,
    MIN_CHANGE_SIGMAS,
    MIN_CORRELATION,
    MIN_EFFECT_LOG,
    MIN_EXPECTED_FACTOR,
    MIN_EXPLAINED_LOG,
    MIN_HALF_PAIRS,
    MIN_HALF_SIGMAS,
    MIN_SHARE_BEYOND_LIGHT,
    MIN_SIGNIFICANT_PAIRS,
    MIN_SLOPE,
    MIN_SLOPE_ERROR_LOG,
    OUTLIER_ERROR_LOG,
    OUTLIER_FACTOR,
)

Halves = tuple[list[PairErrors], list[PairErrors]]
"""Earlier and later pairs: a change seen in one half must explain the other."""

Finding = tuple[str, str]
"""The part that changed, and a description of the change, as part of a sentence."""


def explain(
    pairs: list[PairErrors], fit: Fit, exposures: ExposureTable, baseline_error: float, min_span_frames: int
) -> Finding | None:
    """Return the camera change that the pairs, in frame order, prove; None if they prove none.

    Parameters
    ----------
    fit, exposures
        The fit and exposures of the prediction.
    baseline_error
        Usual absolute error of a whole pair, in ln.
    min_span_frames
        Minimum number of frames that the pairs must span.
    """
    if len(pairs) < 2 * MIN_HALF_PAIRS or pairs[-1].frame1 - pairs[0].frame0 < min_span_frames:
        return None
    return _steeper_response(pairs, exposures, baseline_error) or _other_curve(pairs, fit)


def best_explanations(pairs: list[PairErrors], fit: Fit) -> list[ExplainedChange]:
    """Return the best explanation of the pairs by each of response and vignette, the better first."""
    parts = (ExplainedChange.of(pairs, fit, part) for part in PARTS)
    return sorted(parts, key=lambda explained: -explained.gain)


def _other_curve(pairs: list[PairErrors], fit: Fit) -> Finding | None:
    """Return a change of response or vignette: errors that depend on the grey level or the radius."""
    hypotheses = [_InHalves.of(pairs, fit, whole) for whole in best_explanations(pairs, fit)]
    best, other = sorted(hypotheses, key=lambda found: -found.unseen_gain)
    alike = other.unseen_gain > ALIKE_RATIO * best.unseen_gain
    comparable = other.unseen_gain > COMPARABLE_RATIO * best.unseen_gain
    if alike or (comparable and best.common_error > CLEARLY_WORSE_FACTOR * other.common_error):
        # Darker corners also fit a steeper response, but that would change the relation to the exposure, too.
        best, other = sorted((best, other), key=lambda found: found.common_error)
        alike = alike and best.common_error > ALIKE_RATIO * other.common_error
    whole = best.whole
    explained_log = np.sqrt(max(whole.gain, 0.0) / sum(pair.points for pair in pairs))
    if explained_log < MIN_EXPLAINED_LOG or abs(whole.effect) < MIN_EFFECT_LOG or whole.sigmas < MIN_CHANGE_SIGMAS:
        return None
    if explained_log < MIN_CHANGE_SHARE * abs(whole.effect) or whole.share_beyond_light < MIN_SHARE_BEYOND_LIGHT:
        return None
    if not best.agree:
        return None
    part = " or ".join(PARTS) if alike else whole.part
    size = f"by {np.expm1(whole.effect):+.0%}" if abs(whole.effect) < MAX_STATED_EFFECT_LOG else "greatly"
    return part, f"the {part} changed {size}"


@dataclass(frozen=True)
class _InHalves:
    """A change of one part fitted to all pairs, and to each half; without halves if one is too short."""

    whole: ExplainedChange
    halves: Halves
    by_half: tuple[ExplainedChange, ...]

    @classmethod
    def of(cls, pairs: list[PairErrors], fit: Fit, whole: ExplainedChange) -> _InHalves:
        halves = _halves_by_effect(pairs, whole)
        long_enough = min(map(len, halves)) >= MIN_HALF_PAIRS
        by_half = (ExplainedChange.of(half, fit, whole.part) for half in halves if long_enough)
        return cls(whole, halves, tuple(by_half))

    @property
    def unseen_gain(self) -> float:
        """Reduction of each half's sum of squared errors by the change fitted to the other half, in total."""
        return sum(pair.gain(found.change) for found, unseen in self._crossed for pair in unseen)

    @property
    def common_error(self) -> float:
        """Sum of the absolute errors of whole pairs after the change, in ln."""
        pairs = (pair for half in self.halves for pair in half)
        return sum(abs(pair.error - float(pair.common @ self.whole.change)) for pair in pairs)

    @property
    def agree(self) -> bool:
        """Whether each half clearly shows the same change, and this explains most of the other half."""
        if not self.by_half or min(found.sigmas for found in self.by_half) < MIN_HALF_SIGMAS:
            return False
        if np.corrcoef([found.curve for found in self.by_half])[0, 1] < MIN_CORRELATION:
            return False
        for found, unseen in self._crossed:
            gains = np.array([pair.gain(found.change) for pair in unseen])
            expected = np.array([pair.energy(found.change) for pair in unseen])
            if gains.sum() <= 0 or expected[gains > 0].sum() < MAJORITY * expected.sum():
                return False
        return True

    @property
    def _crossed(self) -> list[tuple[ExplainedChange, list[PairErrors]]]:
        return [*zip(self.by_half, reversed(self.halves), strict=False)]


def _halves_by_effect(pairs: list[PairErrors], found: ExplainedChange) -> Halves:
    """Split pairs into halves in which a change has equal effects: it has none while the camera is stationary."""
    done = np.cumsum([np.sqrt(pair.energy(found.change)) for pair in pairs])
    middle = int(np.searchsorted(done, done[-1] / 2))
    return pairs[:middle], pairs[middle:]


def _steeper_response(pairs: list[PairErrors], exposures: ExposureTable, baseline_error: float) -> Finding | None:
    """Return a change of the response: brightness follows the exposure more or less than before."""
    halves = (pairs[: len(pairs) // 2], pairs[len(pairs) // 2 :])
    steps = [_log_ratios(half, exposures) for half in halves]
    slopes = [_median_slope(half, step) for half, step in zip(halves, steps, strict=True)]
    if any(not (slope > MIN_SLOPE or LIGHT_SLOPE < slope < -MIN_SLOPE) for slope in slopes):
        return None
    errors = [abs(pair.error) for half in halves for pair in half if pair.consecutive]
    if not errors or np.median(errors) < MIN_SLOPE_ERROR_LOG:
        return None
    expected = [slope * step for slope, step in zip(reversed(slopes), steps, strict=True)]
    if not _explained(halves, expected, baseline_error):
        return None
    slope = float(np.mean(slopes))
    steeper = f"brightness follows the exposure {abs(slope):.0%} {'more' if slope > 0 else 'less'} than before"
    return "response", f"the response changed, or a gain is missing from the exposures: {steeper}"


def _explained(halves: Halves, expected: list[FloatArray], baseline_error: float) -> bool:
    """Return whether the expected errors explain most of the pairs in each half in which they are significant."""
    # Steadily fading light is no evidence, so a linear trend in time is removed from errors and expectations.
    for half, change in zip(halves, expected, strict=True):
        known = np.isfinite(change)
        frames = np.array([pair.frame1 - pair.frame0 for pair in half])[known]
        error = _without_drift(np.array([pair.error for pair in half])[known], frames)
        predicted = _without_drift(change[known], frames)
        significant = np.abs(predicted) > MIN_EXPECTED_FACTOR * baseline_error
        better = np.abs(error - predicted)[significant] < np.abs(predicted)[significant] / 2
        if np.count_nonzero(significant) < MIN_SIGNIFICANT_PAIRS or better.mean() < MAJORITY:
            return False
    return True


def _without_drift(values: FloatArray, frames: IntArray) -> FloatArray:
    return values - frames * np.median(values / frames) if len(values) else values


def _log_ratios(pairs: list[PairErrors], exposures: ExposureTable) -> FloatArray:
    """Return ln of the exposure of each pair's second frame over that of its first, NaN if one is unknown."""
    frames = np.array([(pair.frame0, pair.frame1) for pair in pairs])
    return np.asarray(np.diff(exposures.log_exposure_of(frames), axis=1)[:, 0])


def _median_slope(pairs: list[PairErrors], step: FloatArray) -> float:
    """Return the median of error over change of exposure, weighted by the change; 0 if nothing changes."""
    weight = np.where(np.isfinite(step), np.abs(step), 0.0)
    moving = weight > 0
    if not moving.any():
        return 0.0
    return weighted_median(np.array([pair.error for pair in pairs])[moving] / step[moving], weight[moving])


# The frame from which on pairs of frames show a change.


def errors_of_pairs(observations: ExposedObservations, fit: Fit) -> Iterator[PairErrors]:
    """Yield the errors of each pair of frames."""
    begins = np.flatnonzero(np.diff(observations.group, prepend=-1))
    ends = np.flatnonzero(np.diff(observations.group, append=-1)) + 1
    for begin, end in zip(begins, ends, strict=True):
        yield PairErrors.of(observations.where(slice(begin, end)), fit)


def first_changed_frame(pairs: list[PairErrors], fit: Fit, exposures: ExposureTable, suspected: int) -> int:
    """Return the first frame after a change, as accurately as the pairs show it.

    The change that best explains the pairs since the suspected frame reduces the errors of changed pairs by about as
    much as it increases those of the others. The sum of the reductions of all pairs that begin with a frame or later
    is therefore largest for the first pair that shows the change. The change may lie between its two frames, so the
    later one is returned, or the suspected frame if that lies between the last pair before the change and this one.

    Parameters
    ----------
    pairs
        Pairs before and after the change.
    fit, exposures
        The fit and exposures of the prediction.
    suspected
        Number of the frame since which a change is proven: the second one of the first outlier.
    """
    since = [pair for pair in pairs if pair.frame0 >= suspected]
    if not since:
        return suspected
    reductions = _reductions(pairs, since, fit, exposures)
    # What the change explains badly may have changed all the same.
    reductions = np.where(_are_outliers(pairs, suspected), np.maximum(reductions, 0.0), reductions)
    begins, order = np.unique([pair.frame0 for pair in pairs], return_inverse=True)
    since_latest = np.cumsum(np.bincount(order, reductions)[::-1])
    first = begins[::-1][np.argmax(since_latest)]
    changed = min(pair.frame1 for pair in pairs if pair.frame0 >= first)
    unchanged = [pair for pair, by in zip(pairs, reductions, strict=True) if by < 0 and pair.frame1 <= first]
    follows_unchanged = max((pair.frame1 for pair in unchanged), default=0) <= suspected
    return suspected if follows_unchanged and suspected < changed else changed


def _are_outliers(pairs: list[PairErrors], suspected: int) -> BoolArray:
    """Return whether the errors within each pair are unusual, compared with pairs before the suspected frame."""
    effects = np.array([pair.effect for pair in pairs])
    before = np.array([pair.frame1 < suspected for pair in pairs])
    usual = np.median(effects[before]) if before.any() else np.inf
    return np.asarray(effects > OUTLIER_FACTOR * max(usual, MIN_BASELINE_ERROR_LOG))


def _reductions(pairs: list[PairErrors], since: list[PairErrors], fit: Fit, exposures: ExposureTable) -> FloatArray:
    """Return by how much the change since some frame reduces the error of each pair."""
    found = best_explanations(since, fit)[0]
    if found.sigmas >= MIN_HALF_SIGMAS:
        return np.array([pair.gain(found.change) for pair in pairs])
    # Errors within pairs do not show it: brightness follows the exposure differently, as with a missing gain.
    slope = _median_slope(since, _log_ratios(since, exposures))
    error = np.array([pair.error for pair in pairs])
    explained = np.nan_to_num(slope * _log_ratios(pairs, exposures))
    reduction = np.abs(error) - np.abs(error - explained)
    return np.asarray(np.clip(reduction, -OUTLIER_ERROR_LOG, OUTLIER_ERROR_LOG))
