"""Which change of the camera, of its response or vignette, explains the errors of pairs of frames."""

from __future__ import annotations

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.estimation.fit import Fit
from ospc.exposures.table import ExposureTable
from ospc.methods.prediction_errors import PARTS, ExplainedChange, PairErrors
from ospc.robust import weighted_median

Halves = tuple[list[PairErrors], list[PairErrors]]
"""Earlier and later pairs: what one half shows must explain the other."""

Finding = tuple[str, str]
"""What changed, and how, as a part of a sentence."""

MIN_SPAN_S = 3.0
"""Time that the pairs must span: light that changes is often steady again by then."""

FEWEST_PAIRS = 12
"""Pairs in each half by which a change is judged: what happens once is no change."""

MIN_EFFECT_LOG = 0.04
"""Smallest change, in ln of irradiance, that counts: a refocused lens changes the corners by more, drift by less."""

MIN_EXPLAINED_LOG = 0.005
"""Root mean square error within pairs, in ln, that a change must explain. Other responses, and corners that lose a
fifth, soon explained 0.0055 and more in simulated film; what only looked like a change explained 0.0047 at most."""

MIN_CORRELATION = 0.7
"""Correlation of the curves that both halves show; those of real changes had 0.87 and more."""

MIN_SIGMAS, MIN_SIGMAS_OF_HALF = 12.0, 6.0
"""Standard deviations, by the scatter between pairs, that a change must exceed in all pairs and in each half. Real
changes of this size had 17 and 9 or more."""

SYSTEMATIC_LOG = 0.006
"""Standard deviation, in ln, by which registration is wrong in ways that pairs have in common."""

ALIKE_GAIN = 0.9
"""Share of the gain of one explanation from which on the other is as good; both are named then, unless the other
would have to be the larger change: responses imitate corners that lose a fifth by changing two- to tenfold."""

MAJORITY = 0.8
"""Share of the pairs in each half that a change must explain, weighted by what it does to them: a few wrong
registrations prove nothing."""

TELLING = 3.0
"""How many times the usual error a change must make of a pair for the pair to tell."""

FEWEST_TELLING = 6
"""Telling pairs needed in each half."""

LIGHT_SLOPE = -0.75
"""Slope of the error against the change of exposure from which on light that the exposure follows explains it: an
exposure control that keeps brightness constant shows a slope of −1."""

MIN_SLOPE = 0.15
"""Smallest change of that slope by another response."""

MIN_SLOPE_ERROR_LOG = 0.008
"""Median error of neighbours, in ln, below which the slope is not judged: clouds change light by less a frame."""


def explain(
    pairs: list[PairErrors], fit: Fit, exposures: ExposureTable, usual_error: float, min_span_frames: int
) -> Finding | None:
    """Return the change of the camera that pairs, in the order of frames, prove; None if they prove none.

    Parameters
    ----------
    fit, exposures
        What predicted them.
    usual_error
        Usual absolute error of a whole pair, in ln.
    min_span_frames
        Frames that the pairs must span.
    """
    if len(pairs) < 2 * FEWEST_PAIRS or pairs[-1].frame1 - pairs[0].frame0 < min_span_frames:
        return None
    return _steeper_response(pairs, exposures, usual_error) or _other_curve(pairs, fit)


def best_explanations(pairs: list[PairErrors], fit: Fit) -> list[ExplainedChange]:
    """Return what a change of the response and one of the vignette explain of pairs, the better first."""
    parts = (ExplainedChange.of(pairs, fit, part, SYSTEMATIC_LOG) for part in PARTS)
    return sorted(parts, key=lambda explained: -explained.gain)


def _other_curve(pairs: list[PairErrors], fit: Fit) -> Finding | None:
    """Return a change of response or vignette: errors that depend on the grey level or the radius."""
    whole, other = best_explanations(pairs, fit)
    explained_log = np.sqrt(max(whole.gain, 0.0) / sum(pair.points for pair in pairs))
    if explained_log < MIN_EXPLAINED_LOG or abs(whole.effect) < MIN_EFFECT_LOG or whole.sigmas < MIN_SIGMAS:
        return None
    halves = _telling_halves(pairs, whole)
    if min(len(half) for half in halves) < FEWEST_PAIRS:
        return None
    parts = [ExplainedChange.of(half, fit, whole.part, SYSTEMATIC_LOG) for half in halves]
    if min(half.sigmas for half in parts) < MIN_SIGMAS_OF_HALF:
        return None
    if np.corrcoef(parts[0].curve, parts[1].curve)[0, 1] < MIN_CORRELATION:
        return None
    for found, unseen in zip(parts, reversed(halves), strict=True):
        gains = np.array([pair.gain(found.change) for pair in unseen])
        expected = np.array([pair.energy(found.change) for pair in unseen])
        if gains.sum() <= 0 or expected[gains > 0].sum() < MAJORITY * expected.sum():
            return None
    alike = other.gain > ALIKE_GAIN * whole.gain and abs(other.effect) < abs(whole.effect)
    part = " or ".join(PARTS) if alike else whole.part
    return part, f"the {part} changed by {np.expm1(whole.effect):+.0%}"


def _telling_halves(pairs: list[PairErrors], found: ExplainedChange) -> Halves:
    """Split pairs where half of what a change does to them is done: while a camera stands still, nothing shows."""
    done = np.cumsum([np.sqrt(pair.energy(found.change)) for pair in pairs])
    middle = int(np.searchsorted(done, done[-1] / 2))
    return pairs[:middle], pairs[middle:]


def _steeper_response(pairs: list[PairErrors], exposures: ExposureTable, usual_error: float) -> Finding | None:
    """Return a change of the response: brightness follows the exposure more or less than before."""
    halves = (pairs[: len(pairs) // 2], pairs[len(pairs) // 2 :])
    steps = [_log_ratios(half, exposures) for half in halves]
    slopes = [_median_slope(half, step) for half, step in zip(halves, steps, strict=True)]
    if any(not (slope > MIN_SLOPE or LIGHT_SLOPE < slope < -MIN_SLOPE) for slope in slopes):
        return None
    errors = [abs(pair.error) for half in halves for pair in half if pair.of_neighbours]
    if not errors or np.median(errors) < MIN_SLOPE_ERROR_LOG:
        return None
    expected = [slope * step for slope, step in zip(reversed(slopes), steps, strict=True)]
    if not _explained(halves, expected, usual_error):
        return None
    steeper = f"brightness follows the exposure by {np.mean(slopes):+.0%}"
    return "response", f"the response changed, or a gain that is missing in the exposures: {steeper}"


def _explained(halves: Halves, expected: list[FloatArray], usual_error: float) -> bool:
    """Return whether the expected errors explain most of the telling pairs in each half.

    Light that fades steadily is no evidence: what grows evenly with time is taken out of errors and expectations.
    """
    for half, change in zip(halves, expected, strict=True):
        known = np.isfinite(change)
        frames = np.array([pair.frame1 - pair.frame0 for pair in half])[known]
        error = _without_drift(np.array([pair.error for pair in half])[known], frames)
        foretold = _without_drift(change[known], frames)
        telling = np.abs(foretold) > TELLING * usual_error
        better = np.abs(error - foretold)[telling] < np.abs(foretold)[telling] / 2
        if np.count_nonzero(telling) < FEWEST_TELLING or better.mean() < MAJORITY:
            return False
    return True


def _without_drift(values: FloatArray, frames: IntArray) -> FloatArray:
    return values - frames * np.median(values / frames) if len(values) else values


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
    return weighted_median(np.array([pair.error for pair in pairs])[moving] / step[moving], weight[moving])
