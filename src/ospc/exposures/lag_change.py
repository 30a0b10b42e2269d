"""Detect changes of the lag during a run by comparing the latest brightness changes with the known lag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.exposures.brightness import BrightnessChange
from ospc.exposures.brightness_series import BrightnessSeries
from ospc.exposures.flicker import find_flicker, waves
from ospc.exposures.lag_likelihood import LagFit, fit_exposures
from ospc.exposures.table import filled
from ospc.settings.lag import (
    EARLIER_LAG_LEAD,
    LAG_CHANGE_START_TOLERANCE,
    LAG_CHANGE_WINDOW_FRAMES,
    LATER_LAG_LEAD,
    MAX_COMMON_LAG,
    MIN_LAG_LEAD,
    MIN_LAG_PAIRS,
    MIN_LIGHT_PERIOD_FRAMES,
    MIN_PAIRS_BEFORE_LAG_CHANGE,
    SUSPECTED_LAG_CHANGE_LEAD,
)

_LATER = np.arange(-MAX_COMMON_LAG, MAX_COMMON_LAG + 1)
"""Changes of the lag that are tried, in frames; positive if exposures are recorded later than before."""
_UNCHANGED = MAX_COMMON_LAG
"""Index of no change in it."""


@dataclass(frozen=True)
class LagChange:
    """A change of the lag, suspected or ``proven``.

    ``frame`` is the first frame after the change, as accurately as it can be determined. The lag increases by
    ``later_frames``, which may be negative.
    """

    frame: int
    later_frames: int
    proven: bool = False


def detect_lag_change(
    changes: Sequence[BrightnessChange], log_exposure: FloatArray, known_lag: int
) -> LagChange | None:
    """Return the change of the lag that the latest brightness changes show, or None.

    A change is suspected if another lag fits all pairs since some frame better than the known one. It is proven if
    all pairs together, fitted with slow and flickering light, are much more likely with another lag since that frame
    than with the known lag throughout, and if all lags that are nearly as likely lie on the same side of the known
    one.

    Parameters
    ----------
    changes
        Brightness changes between consecutive frames, in frame order.
    log_exposure
        ln of the exposure recorded for each frame, NaN if missing, shape (frames,).
    known_lag
        The latest lag that was certain, in frames.
    """
    start = max(0, len(log_exposure) - LAG_CHANGE_WINDOW_FRAMES)
    window, lags = filled(log_exposure[start:]), (known_lag + _LATER).tolist()
    series = BrightnessSeries.from_changes([change for change in changes if change.frame0 >= start])
    series = series.renumbered(-start).with_exposures(len(window), *lags)
    if len(series.predicted) < MIN_LAG_PAIRS:
        return None
    exposure_changes = np.stack([series.exposure_change(window, lag) for lag in lags])
    log_likelihood = np.array([fit.log_likelihood for fit in fit_exposures(series, exposure_changes)])
    leads = log_likelihood - log_likelihood[_UNCHANGED]
    best, first_frame, lead = _start_of_change(leads, series.frame[series.predicted])
    suspected = LagChange(start + first_frame, int(_LATER[best]))
    if lead < SUSPECTED_LAG_CHANGE_LEAD:
        return None
    since_change = np.where(series.frame < first_frame, exposure_changes[_UNCHANGED], exposure_changes)
    later_frames = _proven_change(series, since_change)
    pairs_before = sum(change.frame0 < suspected.frame for change in changes)
    if not later_frames or not (
        pairs_before >= MIN_PAIRS_BEFORE_LAG_CHANGE
        or _held_before(series, since_change, exposure_changes, later_frames)
    ):
        return suspected
    return replace(suspected, later_frames=later_frames, proven=True)


def _proven_change(series: BrightnessSeries, changes: FloatArray) -> int:
    """Return by how many frames exposures are provably later, given slowly varying or flickering light; 0 if none."""
    # Flicker that auto exposure follows looks like exposures of another lag. If the known lag leaves a flicker
    # unexplained, the proof must hold with and without fitting it.
    light = _slow_light(series.frame)
    fits = fit_exposures(series, changes, light)
    found = _clearly_later(fits)
    flicker = find_flicker(series.frame, fits[_UNCHANGED].unexplained) if found else None
    if flicker is not None:
        flickering = np.hstack([light, waves(series.frame, [flicker.cycles_per_frame])])
        beside_flicker = _clearly_later(fit_exposures(series, changes, flickering))
        found = beside_flicker if beside_flicker * found > 0 else 0
    return found if found and _several_show(series, changes, found) else 0


def _several_show(series: BrightnessSeries, changes: FloatArray, later_frames: int) -> bool:
    """Return whether a change of the lag is proven without the pair to which it matters most."""
    # A jump of the light, or of the stated exposures, is a single pair, which almost any other lag explains.
    matters = np.abs(changes[_UNCHANGED + later_frames] - changes[_UNCHANGED])
    others = np.arange(len(series)) != matters.argmax()
    without = fit_exposures(series.where(others), changes[:, others], _slow_light(series.frame)[others])
    return _clearly_later(without) * later_frames > 0


def _held_before(
    series: BrightnessSeries, since_change: FloatArray, throughout: FloatArray, later_frames: int
) -> bool:
    """Return whether the known lag held before a change: that the later one held throughout is much less likely."""
    # Both arrays have the exposure changes at each lag: since the change, and for all pairs.
    rows = np.stack([changes[_UNCHANGED + later_frames] for changes in (since_change, throughout)])
    changed, always = fit_exposures(series, rows, _slow_light(series.frame))
    return changed.total - always.total > EARLIER_LAG_LEAD


def _clearly_later(fits: Sequence[LagFit]) -> int:
    """Return the change of the lag that is most likely if all likely ones have its sign; 0 otherwise."""
    totals = np.array([fit.total for fit in fits])
    leads = totals - totals[_UNCHANGED]
    likely = _LATER[leads > leads.max() - MIN_LAG_LEAD]
    later = leads.max() > LATER_LAG_LEAD and likely.min() > 0
    earlier = leads.max() > EARLIER_LAG_LEAD and likely.max() < 0
    return int(_LATER[leads.argmax()]) if later or earlier else 0


def _start_of_change(leads: FloatArray, frame: IntArray) -> tuple[int, int, float]:
    """Return the index of the lag with the largest lead from some pair on, that pair's first frame, and the lead."""
    since = np.cumsum(leads[:, ::-1], axis=1)[:, ::-1]
    best = int(np.argmax(since.max(axis=1)))
    pair = int(np.flatnonzero(since[best] > since[best].max() - LAG_CHANGE_START_TOLERANCE)[-1])
    return best, int(frame[pair]), float(since[best, pair])


def _slow_light(frame: IntArray) -> FloatArray:
    """Return a cosine basis for slow brightness changes, shape (pairs, cosines)."""
    frames = frame[-1] + 1 - frame[0]
    halves = np.arange(2 * frames // MIN_LIGHT_PERIOD_FRAMES + 1)
    return np.asarray(np.cos(np.pi * np.outer(frame - frame[0] + 0.5, halves) / frames))
