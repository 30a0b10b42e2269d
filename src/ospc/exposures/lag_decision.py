"""The decision between several lags, whether the images support it clearly enough, and the estimate that results."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.by_value import ByValue
from ospc.exposures.brightness_changes import BrightnessChanges
from ospc.exposures.flicker import Flicker, fast_part, waves, without_waves
from ospc.exposures.lag_likelihood import LagFit, fit_exposures
from ospc.exposures.table import exposure_cycle
from ospc.settings.exposures import (
    CORRELATED_PAIRS,
    DISTINCT_NOISE_SCALES,
    FLAT_RESPONSE_SLOPE,
    FLICKER_FACTOR,
    FLICKERING_EXPOSURE_SHARE,
    FRACTIONAL_LAGS,
    MAX_COMMON_LAG,
    MAX_FRACTIONAL_LAG,
    MIN_CORRELATED_VARIANCE_RATIO,
    MIN_DISTINCT_PAIRS,
    MIN_EXPLAINED_SHARE,
    MIN_FRACTIONAL_LAG_LEAD,
    MIN_LEAD,
    MIN_LEAD_SIGMAS,
    UNCOMMON_LAG_FACTOR,
)

LagState = Literal[
    "determined",
    "constant exposure",
    "too few pairs",
    "changes too small",
    "no response to exposure",
    "ambiguous",
    "follows flicker",
    "between frames",
    "changing",
    "out of range",
]

SILENT: tuple[LagState, ...] = ("no response to exposure", "changes too small")
"""States in which exposures do not show in the images at all."""


@dataclass(frozen=True, eq=False)
class LagEstimate(ByValue):
    """By how many frames the exposures come late.

    Attributes
    ----------
    state
        ``"determined"``, or why the lag is not.
    candidates
        Lags that fit too well to be excluded, best first.
    lags, score, sigmas
        Lags tried, the log likelihood of each relative to the best, and by how many standard deviations the best fits
        better than each, shape (m,).
    fraction_frames
        Where between the best lag and its neighbours the fit is best, in frames.
    fit
        The fit at the best lag, or without exposures where they do not change; None without pairs.
    frame
        Index of the first frame of each pair of the fit, shape (pairs,).
    flicker
        Periodic changes of brightness that the exposures do not explain, strongest first.
    """

    state: LagState
    candidates: tuple[int, ...]
    lags: IntArray
    score: FloatArray
    sigmas: FloatArray
    fraction_frames: float = 0.0
    fit: LagFit | None = field(default=None, repr=False)
    frame: IntArray = field(default_factory=lambda: np.empty(0, np.int64), repr=False)
    flicker: tuple[Flicker, ...] = ()

    @property
    def frames(self) -> int | None:
        """The lag L: frame i − L was taken with the exposure beside frame i. None where it is not determined."""
        return self.candidates[0] if self.state == "determined" else None

    @property
    def pairs(self) -> int:
        """Number of pairs of consecutive frames behind it."""
        return len(self.frame)

    def correction(self, cycle_frames: int | None) -> int | None:
        """Return the lag to correct exposures by; None where that is not certain.

        If exposures repeat after some frames, all lags that differ by whole cycles correct them alike, and any of
        them will do.
        """
        if self.frames is not None or self.state != "ambiguous" or cycle_frames is None:
            return self.frames
        smallest = min(self.candidates, key=abs)
        return None if any((lag - smallest) % cycle_frames for lag in self.candidates) else smallest


@dataclass(frozen=True)
class Trial:
    """Several lags, m of them, fitted to the same changes of brightness, n of them.

    ``changes`` are those of ln exposure of each pair at each lag, shape (m, n). ``flickers`` were fitted too;
    ``nuisance`` are the columns that stand for them, shape (n, columns), None without.
    """

    seen: BrightnessChanges
    log_exposure: FloatArray
    lags: IntArray
    changes: FloatArray
    fits: tuple[LagFit, ...]
    flickers: tuple[Flicker, ...]
    nuisance: FloatArray | None

    @property
    def best(self) -> int:
        """Position of the most likely lag."""
        return int(np.argmax([fit.total for fit in self.fits]))

    @classmethod
    def of(
        cls, seen: BrightnessChanges, log_exposure: FloatArray, lags: IntArray, flickers: tuple[Flicker, ...] = ()
    ) -> Trial:
        """Fit lags to changes of brightness, together with flicker if there is any."""
        changes = np.stack([seen.log_change(log_exposure, lag) for lag in lags.tolist()])
        nuisance = waves(seen.frame, [f.cycles_per_frame for f in flickers]) if flickers else None
        fits = tuple(fit_exposures(seen, changes, nuisance))
        return cls(seen, log_exposure, lags, changes, fits, flickers, nuisance)

    @property
    def likelihood(self) -> float:
        """Log likelihood of the most likely lag."""
        return self.fits[self.best].total


def decide(trial: Trial) -> LagEstimate:
    """Accept the most likely lag, or say why not."""
    best = trial.best
    lead = np.array([trial.fits[best].total - fit.total for fit in trial.fits])
    reach = CORRELATED_PAIRS + trial.seen.step - 1
    sigmas = np.array([_sigmas(trial.fits[best].log_likelihood - fit.log_likelihood, reach) for fit in trial.fits])
    sigmas[best] = 0.0
    # For how many pairs another lag predicts a clearly different change of brightness.
    apart = float(np.median(trial.fits[best].slopes)) * np.abs(trial.changes[best] - trial.changes)
    distinct = np.count_nonzero(apart > DISTINCT_NOISE_SCALES * trial.fits[best].scale, axis=1)
    # Changes over several frames overlap, so they count as fewer pairs.
    caution = FLICKER_FACTOR if trial.flickers else 1.0
    enough = MIN_LEAD * np.sqrt(trial.seen.step) * caution
    doubt = np.where(
        (abs(trial.lags[best]) > MAX_COMMON_LAG) & (abs(trial.lags) <= MAX_COMMON_LAG), UNCOMMON_LAG_FACTOR, 1.0
    )
    few = distinct < MIN_DISTINCT_PAIRS
    open_ = (lead < enough * doubt**2) | (sigmas < MIN_LEAD_SIGMAS * caution * doubt) | few
    rivals = [int(trial.lags[i]) for i in np.argsort(lead, kind="stable") if open_[i] and i != best]
    best, rivals, state = _settled(trial, best, rivals)
    steady = fit_exposures(trial.seen, np.zeros((1, len(trial.seen))), trial.nuisance)[0]
    advantage = trial.fits[best].log_likelihood - steady.log_likelihood
    explained_share = 1 - trial.fits[best].unexplained_share  # NaN where brightness does not change
    if advantage.sum() < enough or (not trial.flickers and not explained_share >= MIN_EXPLAINED_SHARE):
        state, rivals = "no response to exposure", []
        if FLAT_RESPONSE_SLOPE * float(np.sqrt(np.mean(trial.changes**2, axis=1)).min()) < steady.scale:
            state = "changes too small"
    lag, fraction = int(trial.lags[best]), _fraction(trial, best)
    if state == "determined" and _follows_flicker(trial, best):
        state = "follows flicker"
    # The likelihood may go on rising beyond the largest lag tried: an exposure control that follows a slowly swinging
    # light leaves swings of brightness that exposures at a distant, meaningless lag fit.
    if state == "determined" and MAX_COMMON_LAG < abs(lag) == np.abs(trial.lags).max():
        state = "out of range"
    if state == "determined" and abs(fraction) > MAX_FRACTIONAL_LAG:
        state = "between frames"
    if state == "determined" and _differs_within(trial, best):
        state = "changing"
    silent = state in SILENT
    return LagEstimate(
        state,
        () if silent else (lag, *rivals),
        trial.lags,
        -lead,
        sigmas,
        fraction,
        steady if silent else trial.fits[best],
        trial.seen.frame,
        trial.flickers,
    )


def _settled(trial: Trial, best: int, rivals: list[int]) -> tuple[int, list[int], LagState]:
    """Settle what only a cycle of exposures leaves open: return the lag's position, its rivals, and the state.

    Lags that differ by whole cycles look the same. The only one of a usual size is taken; the others stay rivals.
    """
    if not rivals:
        return best, rivals, "determined"
    cycle = exposure_cycle(trial.log_exposure)
    alike = [int(trial.lags[best]), *rivals]
    usual = [lag for lag in alike if abs(lag) <= MAX_COMMON_LAG]
    if cycle is None or len(usual) != 1 or any((lag - usual[0]) % cycle for lag in alike):
        return best, rivals, "ambiguous"
    rest = [lag for lag in alike if lag != usual[0]]
    return int(np.flatnonzero(trial.lags == usual[0])[0]), rest, "determined"


def _sigmas(lead: FloatArray, reach: int) -> float:
    """Return a mean over its standard error, pairs within reach taken to depend on each other (Newey, West 1987)."""
    centred = lead - lead.mean()
    own = float(np.mean(centred**2))
    variance = own
    for step in range(1, min(reach, len(lead) - 1) + 1):
        variance += 2 * (1 - step / (reach + 1)) * float(np.mean(centred[step:] * centred[:-step]))
    variance = max(variance, own * MIN_CORRELATED_VARIANCE_RATIO)
    return float(lead.mean() * np.sqrt(len(lead) / variance)) if variance > 0 else 0.0


def _fraction(trial: Trial, best: int) -> float:
    """Return where between a lag and its neighbours exposures fit best, in frames."""
    if not 0 < best < len(trial.lags) - 1:
        return 0.0
    share = np.abs(FRACTIONAL_LAGS)[:, None]
    neighbours = trial.changes[best + np.sign(FRACTIONAL_LAGS).astype(int)]
    changes = (1 - share) * trial.changes[best] + share * neighbours
    totals = [fit.total for fit in fit_exposures(trial.seen, changes, trial.nuisance)]
    top = int(np.argmax(totals))
    if totals[top] - totals[len(totals) // 2] < MIN_FRACTIONAL_LAG_LEAD:
        return 0.0
    return float(FRACTIONAL_LAGS[top])


def _follows_flicker(trial: Trial, best: int) -> bool:
    """Return whether nearly all fast changes of exposure have the period of unexplained changes of brightness.

    A control loop that follows a flickering lamp is as periodic as the lamp, and the effects of lamp and exposure
    cannot be separated. A programmed cycle of exposures repeats exactly; no control loop does.
    """
    if not trial.flickers or exposure_cycle(trial.log_exposure) is not None:
        return False
    fast = fast_part(trial.seen.frame, trial.changes[best])
    left = without_waves(trial.seen.frame, fast, [f.cycles_per_frame for f in trial.flickers])
    return bool(np.sum(left**2) < (1 - FLICKERING_EXPOSURE_SHARE) * np.sum(fast**2))


def _differs_within(trial: Trial, best: int) -> bool:
    """Return whether a half of the recording clearly prefers another lag."""
    half = len(trial.fits[best].log_likelihood) // 2
    for part in (slice(None, half), slice(half, None)):
        lead = [fit.log_likelihood[part] - trial.fits[best].log_likelihood[part] for fit in trial.fits]
        if any(values.sum() > MIN_LEAD and _sigmas(values, CORRELATED_PAIRS) > MIN_LEAD_SIGMAS for values in lead):
            return True
    return False
