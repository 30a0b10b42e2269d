"""Which of several lags the images speak for, and whether they speak for it clearly enough."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ospc.arrays import FloatArray, IntArray
from ospc.exposures.flicker import Flicker, fast_part, waves, without_waves
from ospc.exposures.lag_likelihood import BrightnessChanges, LagFit, fit_exposures

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

USUAL_LAG = 3
"""Largest lag that is common; larger ones are believed only where nothing else fits."""

_MIN_LEAD = 10.0
_MIN_SIGMAS = 2.0
_FLICKER_CAUTION = 1.5
_UNUSUAL_CAUTION = 1.75
_MIN_TELLING_PAIRS = 5
_MIN_EXPLAINED_SHARE = 0.05
_WEAK_SLOPE = 0.2
_CORRELATED_PAIRS = 4
_FRACTIONS = np.array([-0.6, -0.4, -0.2, 0.0, 0.2, 0.4, 0.6])
_LARGEST_FRACTION = 0.45
_PERIODIC_SHARE = 0.87
_MIN_LOG_CHANGE = 0.005
_LONGEST_CYCLE = 60
_SAME_LOG_EXPOSURE = 1e-3
_CYCLE_SHARE = 0.97


@dataclass(frozen=True)
class LagEstimate:
    """By how many frames the exposures come late.

    Attributes
    ----------
    state
        ``"determined"``, or why the lag is not.
    frames
        The lag L: the exposure written beside frame i is the one that frame i − L was taken with. None where it is
        not determined.
    candidates
        Lags that fit too well to be excluded, best first.
    lags
        Lags tried, shape (m,).
    score
        Log likelihood of each, relative to the best, shape (m,).
    sigmas
        By how many standard deviations the best fits better than each; 0 for itself, shape (m,).
    fraction_frames
        Where between the best lag and its neighbours the fit is best, in frames.
    pairs
        Number of pairs of consecutive frames behind it.
    fit
        The fit at the best lag, or without exposures where they do not change; None without pairs.
    frame
        Index of the first frame of each pair of the fit, shape (pairs,).
    flicker
        Periodic changes of brightness that the exposures do not explain, strongest first.
    """

    state: LagState
    frames: int | None
    candidates: tuple[int, ...]
    lags: IntArray
    score: FloatArray
    sigmas: FloatArray
    fraction_frames: float = 0.0
    pairs: int = 0
    fit: LagFit | None = field(default=None, repr=False)
    frame: IntArray = field(default_factory=lambda: np.empty(0, np.int64), repr=False)
    flicker: tuple[Flicker, ...] = ()

    def correction(self, cycle_frames: int | None) -> int | None:
        """Return the lag to correct exposures by; None where that is not certain.

        Exposures that repeat are corrected alike by all lags that differ by whole cycles, so which of them it is
        need not be known.

        Parameters
        ----------
        cycle_frames
            After how many frames the exposures repeat; None if they do not.
        """
        if self.frames is not None or self.state != "ambiguous" or cycle_frames is None:
            return self.frames
        smallest = min(self.candidates, key=abs)
        return None if any((lag - smallest) % cycle_frames for lag in self.candidates) else smallest

    @property
    def silent(self) -> bool:
        """Whether the exposures change but do not show in the images."""
        return self.state in SILENT


@dataclass(frozen=True)
class Trial:
    """Several lags fitted to the same changes of brightness.

    Attributes
    ----------
    seen
        The changes of brightness, n of them.
    log_exposure
        ln of the exposure of every frame of the recording, shape (frames,).
    lags
        The lags, shape (m,).
    changes
        Change of ln exposure of each pair at each lag, shape (m, n).
    fits
        The fit of each lag.
    flickers
        Periodic changes that were fitted beside.
    """

    seen: BrightnessChanges
    log_exposure: FloatArray
    lags: IntArray
    changes: FloatArray
    fits: tuple[LagFit, ...]
    flickers: tuple[Flicker, ...]

    @property
    def best(self) -> int:
        """Position of the most likely lag."""
        return int(np.argmax([fit.total for fit in self.fits]))

    @classmethod
    def of(
        cls,
        seen: BrightnessChanges,
        log_exposure: FloatArray,
        lags: IntArray,
        flickers: tuple[Flicker, ...] = (),
    ) -> Trial:
        """Fit lags to changes of brightness, beside flicker if there is any."""
        changes = np.stack([seen.log_change(log_exposure, lag) for lag in lags.tolist()])
        nuisance = flicker_columns(seen, flickers)
        fits = tuple(fit_exposures(seen, change, nuisance) for change in changes)
        return cls(seen, log_exposure, lags, changes, fits, flickers)

    @property
    def nuisance(self) -> FloatArray | None:
        """Return the columns that stand for flicker, shape (n, columns); None without."""
        return flicker_columns(self.seen, self.flickers)

    @property
    def likelihood(self) -> float:
        """Log likelihood of the most likely lag."""
        return self.fits[self.best].total


def flicker_columns(seen: BrightnessChanges, flickers: tuple[Flicker, ...]) -> FloatArray | None:
    """Return the columns that stand for flicker, shape (n, columns); None without."""
    return waves(seen.frame, [f.cycles_per_frame for f in flickers]) if flickers else None


def decide(trial: Trial) -> LagEstimate:
    """Accept the most likely lag, or say why not."""
    best = trial.best
    lead = np.array([trial.fits[best].total - fit.total for fit in trial.fits])
    reach = _CORRELATED_PAIRS + trial.seen.step - 1
    sigmas = np.array([_sigmas(trial.fits[best].log_likelihood - fit.log_likelihood, reach) for fit in trial.fits])
    sigmas[best] = 0.0
    telling = np.array([_telling(trial, best, other) for other in range(len(trial.lags))])
    # Changes over several frames overlap, so what looks like many pairs is fewer. Flicker leaves little to go by.
    caution = _FLICKER_CAUTION if trial.flickers else 1.0
    enough = _MIN_LEAD * np.sqrt(trial.seen.step) * caution
    # A large lag is rare, so it takes more to believe that it is none of the usual ones.
    doubt = np.where((abs(trial.lags[best]) > USUAL_LAG) & (abs(trial.lags) <= USUAL_LAG), _UNUSUAL_CAUTION, 1.0)
    few = telling < _MIN_TELLING_PAIRS
    open_ = (lead < enough * doubt**2) | (sigmas < _MIN_SIGMAS * caution * doubt) | few
    rivals = [int(trial.lags[i]) for i in np.argsort(lead, kind="stable") if open_[i] and i != best]
    best, rivals, state = _settled(trial, best, rivals)
    steady = fit_exposures(trial.seen, np.zeros(len(trial.seen)), trial.nuisance)
    advantage = trial.fits[best].log_likelihood - steady.log_likelihood
    if advantage.sum() < enough or (not trial.flickers and _explained_share(trial.fits[best]) < _MIN_EXPLAINED_SHARE):
        state, rivals = "no response to exposure", []
        if _WEAK_SLOPE * float(np.sqrt(np.mean(trial.changes**2, axis=1)).min()) < steady.scale:
            state = "changes too small"
    fraction = _fraction(trial, best)
    if state == "determined" and _follows_flicker(trial, best):
        state = "follows flicker"
    if state == "determined" and _at_the_end(trial, best):
        state = "out of range"
    if state == "determined" and abs(fraction) > _LARGEST_FRACTION:
        state = "between frames"
    if state == "determined" and _differs_within(trial, best):
        state = "changing"
    lag = int(trial.lags[best])
    silent = state in SILENT
    known = state == "determined"
    return LagEstimate(
        state,
        lag if known else None,
        () if silent else (lag, *rivals),
        trial.lags,
        -lead,
        sigmas,
        fraction,
        len(trial.seen),
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
    usual = [lag for lag in alike if abs(lag) <= USUAL_LAG]
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
    variance = max(variance, own / 2)
    return float(lead.mean() * np.sqrt(len(lead) / variance)) if variance > 0 else 0.0


def _at_the_end(trial: Trial, best: int) -> bool:
    """Return whether a lag is the largest tried, and no usual one: the best may be a larger one that means nothing.

    An exposure control that chases a slowly swinging light leaves swings of brightness that exposures of another
    time fit, however far away.
    """
    lag = abs(int(trial.lags[best]))
    return lag > USUAL_LAG and lag == int(np.abs(trial.lags).max())


def _explained_share(fit: LagFit) -> float:
    """Return the share of the energy of all changes that the exposures explain."""
    energy = float(np.sum(fit.observed**2))
    return 1 - float(np.sum(fit.unexplained**2)) / energy if energy > 0 else 0.0


def _telling(trial: Trial, first: int, second: int) -> int:
    """Return for how many pairs two lags mean different changes of brightness, beyond the noise."""
    slope = float(np.median(trial.fits[first].slopes))
    apart = slope * np.abs(trial.changes[first] - trial.changes[second])
    return int(np.count_nonzero(apart > 0.5 * trial.fits[first].scale))


def _fraction(trial: Trial, best: int) -> float:
    """Return where between a lag and its neighbours exposures fit best, in frames."""
    if not 0 < best < len(trial.lags) - 1:
        return 0.0
    totals = []
    for part in _FRACTIONS:
        neighbour = trial.changes[best + int(np.sign(part))]
        change = (1 - abs(part)) * trial.changes[best] + abs(part) * neighbour
        totals.append(fit_exposures(trial.seen, change, trial.nuisance).total)
    top = int(np.argmax(totals))
    if totals[top] - totals[len(totals) // 2] < _MIN_LEAD / 2:
        return 0.0
    return float(_FRACTIONS[top])


def _follows_flicker(trial: Trial, best: int) -> bool:
    """Return whether nearly all fast changes of exposure have the period of unexplained changes of brightness.

    A control loop that chases a flickering lamp is as periodic as the lamp, and what is the lamp's and what the
    exposure's cannot be told apart. A programmed cycle of exposures repeats exactly; no control loop does.
    """
    if not trial.flickers or exposure_cycle(trial.log_exposure) is not None:
        return False
    fast = fast_part(trial.seen.frame, trial.changes[best])
    left = without_waves(trial.seen.frame, fast, [f.cycles_per_frame for f in trial.flickers])
    return bool(np.sum(left**2) < (1 - _PERIODIC_SHARE) * np.sum(fast**2))


def exposure_cycle(log_exposure: FloatArray) -> int | None:
    """Return after how many frames the exposures repeat; None if they do not, or never change.

    Parameters
    ----------
    log_exposure
        ln of the exposure of every frame, shape (frames,).
    """
    if np.ptp(log_exposure) < _MIN_LOG_CHANGE:
        return None
    for period in range(2, min(_LONGEST_CYCLE, len(log_exposure) // 3) + 1):
        same = np.abs(log_exposure[period:] - log_exposure[:-period]) < _SAME_LOG_EXPOSURE
        if same.mean() >= _CYCLE_SHARE:
            return period
    return None


def _differs_within(trial: Trial, best: int) -> bool:
    """Return whether a half of the recording clearly prefers another lag."""
    half = len(trial.fits[best].log_likelihood) // 2
    for part in (slice(None, half), slice(half, None)):
        lead = [fit.log_likelihood[part] - trial.fits[best].log_likelihood[part] for fit in trial.fits]
        if any(values.sum() > _MIN_LEAD and _sigmas(values, _CORRELATED_PAIRS) > _MIN_SIGMAS for values in lead):
            return True
    return False
