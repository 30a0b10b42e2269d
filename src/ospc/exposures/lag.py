"""The lag of the exposures: by how many frames the metadata come late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ospc.arrays import FloatArray
from ospc.exposures.brightness_changes import BrightnessChanges
from ospc.exposures.flicker import Flicker, find_flicker, in_long_runs, main_line, without_waves
from ospc.exposures.lag_decision import SILENT, LagEstimate, Trial, decide
from ospc.exposures.lag_likelihood import fit_exposures
from ospc.exposures.table import exposure_cycle
from ospc.settings.exposures import (
    AGREEING_SIGMAS,
    CONSTANT_EXPOSURE_LOG,
    DOUBTFUL_RESPONSE_SLOPE,
    EXPOSURE_ERROR_SCALES,
    LONG_INTERVALS_FRAMES,
    MAX_DEFICIT,
    MAX_FLICKER_CANDIDATES,
    MAX_FLICKERS,
    MAX_LAG,
    MAX_SWINGING_EXPOSURE_LOG,
    MIN_FLICKER_LEAD,
    MIN_LAG_PAIRS,
    MIN_PAIR_LOG_CHANGE,
    OPPOSING_SIGMAS,
    SAME_FREQUENCY,
    SWINGING_EXPOSURE_SHARE,
)


def estimate_lag(seen: BrightnessChanges, log_exposure: FloatArray, max_lag: int = MAX_LAG) -> LagEstimate:
    """Estimate by how many frames exposures come late.

    Every lag is fitted to the same pairs of frames (those whose exposure is known for all lags). The most likely lag
    is accepted if it beats every other clearly, both in likelihood and against the scatter of its lead from pair to
    pair (Vuong 1989), on several pairs, in the whole recording, and not by lying half way to a neighbour.

    Parameters
    ----------
    seen
        Changes of brightness between consecutive frames.
    log_exposure
        ln of the exposure of every frame of the recording, shape (frames,).
    max_lag
        Largest lag tried, either way.
    """
    lags = np.arange(-max_lag, max_lag + 1)
    inner = seen.within(len(log_exposure), -max_lag, max_lag)
    nothing = np.zeros(len(lags))
    unknown = LagEstimate("constant exposure", (), lags, nothing, nothing, frame=inner.frame)
    constant = float(np.ptp(log_exposure)) < CONSTANT_EXPOSURE_LOG
    if len(inner.driven) < MIN_LAG_PAIRS:
        return unknown if constant else replace(unknown, state="too few pairs")
    changes = np.stack([inner.log_change(log_exposure, lag) for lag in lags.tolist()])
    if constant or np.abs(changes).max() < MIN_PAIR_LOG_CHANGE:
        trial = _with_flicker(Trial.of(inner, log_exposure, np.zeros(1, np.int64)))
        return replace(unknown, fit=fit_exposures(inner, changes[max_lag : max_lag + 1])[0], flicker=trial.flickers)
    trial = _with_flicker(Trial.of(inner, log_exposure, lags))
    return _of_all_pairs(_decide(trial, seen), trial, inner)


def _decide(trial: Trial, seen: BrightnessChanges) -> LagEstimate:
    """Return the lag from changes from frame to frame, or else from fits that suffer less from wrong exposures."""
    first = decide(trial)
    doubtful = first.fit is not None and float(np.median(first.fit.slopes)) < DOUBTFUL_RESPONSE_SLOPE
    settled = first.state not in ("ambiguous", *SILENT)
    if settled and not doubtful:
        holds = _holds_beside_a_swinging_light(first, trial)
        return first if holds else replace(first, state="follows flicker")
    scattered = None if trial.flickers else _with_scatter(trial)
    if scattered is not None:
        return replace(scattered, fit=trial.fits[int(np.flatnonzero(trial.lags == scattered.frames)[0])])
    return first if settled else _over_longer(first, trial, seen)


def _of_all_pairs(found: LagEstimate, trial: Trial, seen: BrightnessChanges) -> LagEstimate:
    """Return an estimate whose fit covers all pairs, where flicker was looked for in some of them."""
    if len(trial.seen) == len(seen) or found.fit is None:
        return found
    change = seen.log_change(trial.log_exposure, found.candidates[0]) if found.candidates else np.zeros(len(seen))
    return replace(found, fit=fit_exposures(seen, change[None])[0], frame=seen.frame)


def _holds_beside_a_swinging_light(first: LagEstimate, trial: Trial) -> bool:
    """Return whether a lag holds even if the light swings with the main period of the exposures.

    An exposure control that follows a swinging light leaves swings of brightness, which exposures at a wrong lag fit
    as well. Its exposures swing with one period, and little.
    """
    if first.frames is None or trial.flickers or exposure_cycle(trial.log_exposure) is not None:
        return True
    change = trial.changes[trial.best]
    found = main_line(trial.seen.frame, change)
    if found is None:
        return True
    line, share = found
    if share < SWINGING_EXPOSURE_SHARE or np.std(trial.log_exposure[trial.seen.frame]) > MAX_SWINGING_EXPOSURE_LOG:
        return True
    flicker = (Flicker(line, float(np.sqrt(2) * np.std(change)), share),)
    return decide(Trial.of(trial.seen, trial.log_exposure, trial.lags, flicker)).frames == first.frames


def _over_longer(first: LagEstimate, trial: Trial, seen: BrightnessChanges) -> LagEstimate:
    """Return the estimate from changes over several frames where those from frame to frame settle nothing."""
    pairs = seen.where(in_long_runs(seen.frame)) if trial.flickers else seen
    tried = (_over(step, pairs, trial) for step in LONG_INTERVALS_FRAMES)
    overs = [over for over in tried if over is not None]
    agreed = next((over for over in overs if _agree(first, over)), None)
    silent = first.state in SILENT
    chosen = agreed or (next((over for over in overs if over.state not in SILENT), None) if silent else None)
    if chosen is None:
        return first
    # The fit that is reported stays the one to changes from frame to frame.
    at = int(np.flatnonzero(trial.lags == chosen.candidates[0])[0])
    return replace(chosen, state=chosen.state if agreed else "ambiguous", fit=trial.fits[at], frame=trial.seen.frame)


def _agree(first: LagEstimate, longer: LagEstimate) -> bool:
    """Return whether changes over several frames settle what those from frame to frame leave open."""
    if longer.frames is None or longer.frames not in first.candidates:
        return False
    at = int(np.flatnonzero(longer.lags == longer.frames)[0])
    needed = AGREEING_SIGMAS if longer.frames == first.candidates[0] else OPPOSING_SIGMAS
    sure = np.delete(longer.sigmas, at).min() >= needed
    return bool(sure and first.score[at] > -MAX_DEFICIT)


def _with_scatter(trial: Trial) -> LagEstimate | None:
    """Return the estimate that allows for errors of single exposures; None unless all sizes of errors agree on it.

    Where errors of the metadata outweigh most changes of exposure, a model without them finds that brightness hardly
    follows the exposure, and its preferred lag means nothing.
    """
    found = [
        decide(Trial.of(replace(trial.seen, scatter=scatter), trial.log_exposure, trial.lags))
        for scatter in EXPOSURE_ERROR_SCALES
    ]
    agreed = len({estimate.candidates[:1] for estimate in found}) == 1
    possible = all(estimate.state in ("determined", "ambiguous") for estimate in found)
    return next((e for e in found if e.frames is not None), None) if agreed and possible else None


def _over(step: int, seen: BrightnessChanges, trial: Trial) -> LagEstimate | None:
    """Return the estimate from changes over several frames; None where there are too few."""
    longer = seen.summed(step).within(len(trial.log_exposure), *trial.lags.tolist())
    if len(longer.driven) < MIN_LAG_PAIRS:
        return None
    return decide(Trial.of(longer, trial.log_exposure, trial.lags, trial.flickers))


def _with_flicker(trial: Trial) -> Trial:
    """Return the trial with periodic changes fitted too, where these make some lag much more likely.

    An exposure control that follows the flicker of a lamp is as periodic as the lamp. What it does at that frequency
    says nothing about the metadata; at some wrong lag it even seems to explain the flicker. So the frequencies that
    any lag leaves unexplained are tried, in long runs of frames only.
    """
    long = trial.seen.where(in_long_runs(trial.seen.frame))
    if len(long.driven) < MIN_LAG_PAIRS:
        return trial
    found = trial if len(long) == len(trial.seen) else Trial.of(long, trial.log_exposure, trial.lags)
    for _ in range(MAX_FLICKERS):
        tried = [Trial.of(long, trial.log_exposure, trial.lags, (*found.flickers, line)) for line in _lines(found)]
        better = max(tried, key=lambda each: each.likelihood, default=found)
        if better.likelihood - found.likelihood < MIN_FLICKER_LEAD:
            break
        found = better
    return found if found.flickers else trial


def _lines(trial: Trial) -> list[Flicker]:
    """Return the different frequencies that stand out in what the lags leave unexplained."""
    known = [flicker.cycles_per_frame for flicker in trial.flickers]
    lines: list[Flicker] = []
    for fit in sorted(trial.fits, key=lambda fit: -fit.total):
        line = find_flicker(trial.seen.frame, without_waves(trial.seen.frame, fit.unexplained, known))
        if line is not None and all(abs(line.cycles_per_frame - f.cycles_per_frame) > SAME_FREQUENCY for f in lines):
            lines.append(line)
    return lines[:MAX_FLICKER_CANDIDATES]
