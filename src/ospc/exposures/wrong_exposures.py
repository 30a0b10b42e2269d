"""Find individual wrong exposures: they differ from both neighbours, and the images do not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.errors import counted, listed
from ospc.exposures.brightness_series import BrightnessSeries
from ospc.settings.exposures import (
    MAX_STEP_GAP_FRAMES,
    MAX_WRONG_SHARE,
    MIN_SHOWN_SHARE,
    MIN_UNIT_STEP_LOG,
    MIN_WRONG_LOG,
)
from ospc.settings.lag import MAX_LAG


def wrong_exposures(series: BrightnessSeries, log_exposure: FloatArray) -> IntArray:
    """Return the frames recorded with a wrong exposure, in order; none if they are too many to be exceptions.

    The exposure of such a frame is longer or shorter than those before and after it, but neither this frame nor those
    near it, whose exposure it may be, are brighter or darker than their neighbours. Frames that were not compared
    with both neighbours are not judged.

    Parameters
    ----------
    series
        The brightness changes between consecutive frames.
    log_exposure
        ln of the recorded exposures, shape (frames,).
    """
    step = np.diff(log_exposure)
    recorded = _peak(step)
    suspects = np.flatnonzero(recorded > MIN_WRONG_LOG)
    if not len(suspects):
        return suspects
    change = np.full(len(step), np.nan)
    change[series.frame] = series.means[0]
    seen = _peak(change)
    shown = _largest_near(np.nan_to_num(seen), suspects)
    wrong = np.isfinite(seen[suspects]) & (shown < MIN_SHOWN_SHARE * recorded[suspects])
    found = suspects[wrong] + 1
    return found if len(found) <= MAX_WRONG_SHARE * len(series) else np.empty(0, np.int64)


def unshown_steps(series: BrightnessSeries, log_exposure: FloatArray) -> IntArray:
    """Return after which frames the exposures change by a factor that no frame near them shows, in order.

    The unit of the exposures probably changes there. A change between frames that were not compared shows in the grey
    levels before and after it. The arguments are those of :func:`wrong_exposures`; there are none if such steps are
    frequent.
    """
    suspects = _unit_steps(log_exposure)
    if not len(suspects) or len(suspects) > MAX_WRONG_SHARE * len(series):
        return np.empty(0, np.int64)
    step = np.abs(np.diff(log_exposure))
    change = np.zeros(len(step))
    change[series.frame] = np.abs(series.means[0])
    shown = np.maximum(_largest_near(change, suspects), _change_across(series, suspects))
    return suspects[shown < MIN_SHOWN_SHARE * step[suspects]]


def unreal_steps(steps: IntArray, series: BrightnessSeries, log_exposure: FloatArray) -> IntArray:
    """Return those of the unshown steps that are certainly not real.

    If the images show other steps, a step between frames that are far from the nearest compared ones may be real: the
    scene may have changed meanwhile.
    """
    if len(steps) == len(_unit_steps(log_exposure)):
        return steps
    after = np.searchsorted(series.frame, steps)
    frame = np.concatenate([[-np.inf], series.frame, [np.inf]])
    return np.asarray(steps[frame[after + 1] - frame[after] <= MAX_STEP_GAP_FRAMES])


def _unit_steps(log_exposure: FloatArray) -> IntArray:
    """Return after which frames the exposures change as much as with another unit."""
    return np.flatnonzero(np.abs(np.diff(log_exposure)) > MIN_UNIT_STEP_LOG)


def _change_across(series: BrightnessSeries, places: IntArray) -> FloatArray:
    """Return the change of ln grey from the last pair before each place to the first after it, whatever the lag."""
    # It is infinite if it cannot be known; zero if all pairs near the place were compared, so that it is not needed.
    before = np.searchsorted(series.frame, places - MAX_LAG) - 1
    after = np.searchsorted(series.frame, places + MAX_LAG, side="right")
    inside = after - before - 1
    level = np.pad(series.log_grey, 1, mode="edge")  # a place at the end has pairs on one side only
    change = np.abs(level[after + 1] - level[before + 1])
    unknown = (inside == 0) & ((before < 0) | (after == len(series)))
    return np.where(unknown, np.inf, np.where(inside > 2 * MAX_LAG, 0.0, change))


def _largest_near(values: FloatArray, places: IntArray) -> FloatArray:
    """Return the largest value near each place: with a lag, another frame would show the exposure there."""
    return np.array([values[max(0, place - MAX_LAG) : place + MAX_LAG + 1].max() for place in places])


def away_from(steps: IntArray, series: BrightnessSeries) -> BrightnessSeries:
    """Return the pairs of frames to which no lag moves any of the steps after these frames."""
    distance = np.abs(series.frame[:, None] - steps)
    return series.where(distance.min(axis=1, initial=MAX_LAG + 1) > MAX_LAG) if len(steps) else series


def _peak(step: FloatArray) -> FloatArray:
    """Return the height of the peak or dip at each inner frame, given the steps between frames, (n,) -> (n - 1,)."""
    # It is the smaller of the two steps; zero if both go in the same direction.
    before, after = step[:-1], step[1:]
    height = np.minimum(np.abs(before), np.abs(after))
    return np.where(before * after > 0, 0.0, height)


def in_words(frames: Sequence[int]) -> str:
    """Return a note on frames with wrong exposures."""
    one = len(frames) == 1
    return (
        f"{counted(len(frames), 'exposure')} contradicted by the images and by the exposures before and after "
        f"{'was' if one else 'were'} ignored: {'frame' if one else 'frames'} {listed(frames)}"
    )
