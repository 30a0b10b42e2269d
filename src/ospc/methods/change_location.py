"""Location of a camera change: the frame from which on the pairs of frames show it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ospc.arrays import BoolArray, FloatArray
from ospc.estimation.fit import Fit
from ospc.exposures.table import ExposureTable
from ospc.methods.change_hypotheses import best_explanations, log_ratios, median_slope
from ospc.methods.prediction_errors import PairErrors
from ospc.observations import ExposedObservations
from ospc.settings.methods import MIN_BASELINE_ERROR_LOG, MIN_HALF_SIGMAS, OUTLIER_ERROR_LOG, OUTLIER_FACTOR


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
    slope = median_slope(since, log_ratios(since, exposures))
    error = np.array([pair.error for pair in pairs])
    explained = np.nan_to_num(slope * log_ratios(pairs, exposures))
    reduction = np.abs(error) - np.abs(error - explained)
    return np.asarray(np.clip(reduction, -OUTLIER_ERROR_LOG, OUTLIER_ERROR_LOG))
