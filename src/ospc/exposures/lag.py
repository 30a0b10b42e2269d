"""Estimate the lag of the exposures: by how many frames the metadata are late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.exposures.brightness_series import BrightnessSeries
from ospc.exposures.flicker import Flicker, find_flicker, in_long_runs, strongest_wave, without_waves
from ospc.exposures.lag_likelihood import fit_exposures
from ospc.exposures.lag_selection import UNRESPONSIVE, LagEstimate, LagHypotheses, select_lag
from ospc.exposures.table import exposure_cycle
from ospc.settings.exposures import CONSTANT_EXPOSURE_LOG, MAX_UNEXPLAINED_SHARE
from ospc.settings.lag import (
    AGREEING_LAG_SIGMAS,
    DOUBTFUL_RESPONSE_SLOPE,
    EXPOSURE_ERROR_SCALES,
    LONG_INTERVALS_FRAMES,
    MAX_FLICKER_CANDIDATES,
    MAX_FLICKERS,
    MAX_FOLLOWING_CHANGE_LOG,
    MAX_LAG,
    MAX_LONG_INTERVAL_DEFICIT,
    MAX_SWINGING_EXPOSURE_LOG,
    MIN_FLICKER_LEAD,
    MIN_LAG_PAIRS,
    MIN_PAIR_LOG_CHANGE,
    OPPOSING_LAG_SIGMAS,
    SAME_FREQUENCY,
    SWINGING_EXPOSURE_SHARE,
)


def estimate_lag(series: BrightnessSeries, log_exposure: FloatArray) -> LagEstimate:
    """Estimate by how many frames the exposures are late.

    Every lag is fitted to the same pairs of frames: those whose exposures are known at all lags. The most likely lag
    is accepted if it clearly beats every other one in likelihood, relative to the scatter of its lead from pair to
    pair (Vuong 1989), on several pairs and in both halves of the recording, and if no fractional lag fits better.

    Parameters
    ----------
    series
        Brightness changes between consecutive frames.
    log_exposure
        ln of the exposure of every frame of the recording, shape (frames,).
    """
    lags = np.arange(-MAX_LAG, MAX_LAG + 1)
    comparable = series.with_exposures(len(log_exposure), -MAX_LAG, MAX_LAG)
    zeros = np.zeros(len(lags))
    unknown = LagEstimate("constant exposure", (), lags, zeros, zeros, frame=comparable.frame)
    constant = float(np.ptp(log_exposure)) < CONSTANT_EXPOSURE_LOG
    if len(comparable.predicted) < MIN_LAG_PAIRS:
        return unknown if constant else replace(unknown, state="too few pairs")
    changes = np.stack([comparable.exposure_change(log_exposure, lag) for lag in lags.tolist()])
    if constant or np.abs(changes).max() < MIN_PAIR_LOG_CHANGE:
        tried = _with_flicker(LagHypotheses.fit(comparable, log_exposure, np.zeros(1, np.int64)))
        (fit,) = fit_exposures(comparable, changes[MAX_LAG : MAX_LAG + 1])
        return replace(unknown, fit=fit, flicker=tried.flickers)
    tried = _with_flicker(LagHypotheses.fit(comparable, log_exposure, lags))
    return _with_fit_to_all_pairs(_select(tried, series), tried, comparable)


def _select(tried: LagHypotheses, series: BrightnessSeries) -> LagEstimate:
    """Return the lag from frame-to-frame changes, or from fits that are less sensitive to wrong exposures."""
    first = select_lag(tried)
    doubtful = first.fit is not None and float(np.median(first.fit.slopes)) < DOUBTFUL_RESPONSE_SLOPE
    settled = first.state not in ("ambiguous", *UNRESPONSIVE)
    if settled and not doubtful:
        survives = _survives_periodic_light(first, tried)
        return first if survives else replace(first, state="follows flicker")
    inexact = None if tried.flickers else _with_inexact_exposures(tried)
    if inexact is not None:
        return replace(inexact, fit=tried.fits[tried.index_of(inexact.candidates[0])])
    return first if settled else _over_long_intervals(first, tried, series)


def _with_fit_to_all_pairs(found: LagEstimate, tried: LagHypotheses, series: BrightnessSeries) -> LagEstimate:
    """Return the estimate with a fit to all pairs, because flicker may have been fitted to some of them only."""
    if len(tried.series) == len(series) or found.fit is None:
        return found
    known = bool(found.candidates)
    change = series.exposure_change(tried.log_exposure, found.candidates[0]) if known else np.zeros(len(series))
    return replace(found, fit=fit_exposures(series, change[None])[0], frame=series.frame)


def explained_by_inverse(found: LagEstimate, series: BrightnessSeries, log_exposure: FloatArray) -> float:
    """Return the share of the brightness changes that inverse exposures explain; 0 if the exposures fit well."""
    poor = found.fit is not None and found.fit.unexplained_share > MAX_UNEXPLAINED_SHARE
    inverse = estimate_lag(series, -log_exposure).fit if poor and found.state != "constant exposure" else None
    return 0.0 if inverse is None else 1 - inverse.unexplained_share


def _with_flicker(tried: LagHypotheses) -> LagHypotheses:
    """Return the lags fitted together with flicker, if flicker makes some lag much more likely."""
    # Auto exposure that follows the flicker of a lamp is as periodic as the lamp. At that frequency it contains no
    # information about the lag; a wrong lag may even seem to explain the flicker. This tries the frequencies that any
    # lag leaves unexplained, in long runs of frames only.
    in_runs = tried.series.where(in_long_runs(tried.series.frame))
    if len(in_runs.predicted) < MIN_LAG_PAIRS:
        return tried
    all_in_runs = len(in_runs) == len(tried.series)
    found = tried if all_in_runs else LagHypotheses.fit(in_runs, tried.log_exposure, tried.lags)
    for _ in range(MAX_FLICKERS):
        with_one_more = [
            LagHypotheses.fit(in_runs, tried.log_exposure, tried.lags, (*found.flickers, flicker))
            for flicker in _flicker_candidates(found)
        ]
        better = max(with_one_more, key=lambda each: each.max_log_likelihood, default=found)
        if better.max_log_likelihood - found.max_log_likelihood < MIN_FLICKER_LEAD:
            break
        found = better
    return found if found.flickers else tried


def _flicker_candidates(tried: LagHypotheses) -> list[Flicker]:
    """Return the distinct significant frequencies in the residuals of the lags."""
    frame, known = tried.series.frame, [flicker.cycles_per_frame for flicker in tried.flickers]
    candidates: list[Flicker] = []
    for fit in sorted(tried.fits, key=lambda fit: -fit.total):
        found = find_flicker(frame, without_waves(frame, fit.unexplained, known))
        if found is None:
            continue
        if all(abs(found.cycles_per_frame - other.cycles_per_frame) > SAME_FREQUENCY for other in candidates):
            candidates.append(found)
    return candidates[:MAX_FLICKER_CANDIDATES]


def _survives_periodic_light(first: LagEstimate, tried: LagHypotheses) -> bool:
    """Return whether a lag stays the same if light with the main period of the exposures is fitted too."""
    # Auto exposure that follows a periodic light leaves periodic brightness changes, which exposures at a wrong lag
    # fit equally well. Such exposures have a single period and a small amplitude.
    if first.frames is None or tried.flickers or exposure_cycle(tried.log_exposure) is not None:
        return True
    change = tried.changes[tried.best]
    found = strongest_wave(tried.series.frame, change)
    if found is None:
        return True
    cycles_per_frame, share = found
    deviation = np.std(tried.log_exposure[tried.series.frame])
    if share < SWINGING_EXPOSURE_SHARE or deviation > MAX_SWINGING_EXPOSURE_LOG:
        return True
    periodic_light = Flicker(cycles_per_frame, float(np.sqrt(2) * np.std(change)), share)
    with_light = LagHypotheses.fit(tried.series, tried.log_exposure, tried.lags, (periodic_light,))
    return select_lag(with_light).frames == first.frames


def _with_inexact_exposures(tried: LagHypotheses) -> LagEstimate | None:
    """Return the estimate that allows for errors of individual exposures; None if it depends on their size."""
    # If errors of the metadata outweigh most exposure changes, a model without such errors finds that brightness
    # hardly follows the exposure, and its best lag is meaningless.
    found = [
        select_lag(LagHypotheses.fit(replace(tried.series, exposure_error=error), tried.log_exposure, tried.lags))
        for error in EXPOSURE_ERROR_SCALES
    ]
    agreed = len({estimate.candidates[:1] for estimate in found}) == 1
    possible = all(estimate.state in ("determined", "ambiguous") for estimate in found)
    return next((e for e in found if e.frames is not None), None) if agreed and possible else None


def _over_long_intervals(first: LagEstimate, tried: LagHypotheses, series: BrightnessSeries) -> LagEstimate:
    """Return the estimate from changes over several frames, or the first one if they do not add information."""
    pairs = series.where(in_long_runs(series.frame)) if tried.flickers else series
    estimates = [e for e in (_over(frames, pairs, tried) for frames in LONG_INTERVALS_FRAMES) if e is not None]
    agreed = next((estimate for estimate in estimates if _agree(first, estimate)), None)
    chosen = agreed
    # Flicker or errors of the metadata may hide small changes of the exposure from frame to frame, but no large ones.
    hidden = first.state in UNRESPONSIVE and tried.change_rms < MAX_FOLLOWING_CHANGE_LOG
    if chosen is None and hidden:
        chosen = next((estimate for estimate in estimates if estimate.state not in UNRESPONSIVE), None)
    if chosen is None:
        return first
    # Still report the fit to frame-to-frame changes.
    fit = tried.fits[tried.index_of(chosen.candidates[0])]
    return replace(chosen, state=chosen.state if agreed else "ambiguous", fit=fit, frame=tried.series.frame)


def _over(interval_frames: int, series: BrightnessSeries, tried: LagHypotheses) -> LagEstimate | None:
    """Return the estimate from changes over this many frames; None if there are too few pairs."""
    longer = series.over(interval_frames).with_exposures(len(tried.log_exposure), *tried.lags.tolist())
    if len(longer.predicted) < MIN_LAG_PAIRS:
        return None
    return select_lag(LagHypotheses.fit(longer, tried.log_exposure, tried.lags, tried.flickers))


def _agree(first: LagEstimate, longer: LagEstimate) -> bool:
    """Return whether changes over several frames settle a lag that frame-to-frame changes leave open."""
    if longer.frames is None or longer.frames not in first.candidates:
        return False
    at = int(np.flatnonzero(longer.lags == longer.frames)[0])
    needed = AGREEING_LAG_SIGMAS if longer.frames == first.candidates[0] else OPPOSING_LAG_SIGMAS
    sure = np.delete(longer.sigmas, at).min() >= needed
    return bool(sure and first.score[at] > -MAX_LONG_INTERVAL_DEFICIT)
