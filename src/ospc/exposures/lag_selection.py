"""Select the lag that the images support best, and decide whether it is certain."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from ospc.arrays import ByValue, FloatArray, IntArray
from ospc.exposures.brightness_series import BrightnessSeries
from ospc.exposures.flicker import Flicker, fast_part, waves, without_waves
from ospc.exposures.lag_likelihood import LagFit, fit_exposures
from ospc.exposures.table import exposure_cycle
from ospc.settings.lag import (
    CORRELATED_PAIRS,
    DISTINCT_NOISE_SCALES,
    FLAT_RESPONSE_SLOPE,
    FLICKER_LEAD_FACTOR,
    FLICKERING_EXPOSURE_SHARE,
    FRACTIONAL_LAGS,
    MAX_COMMON_LAG,
    MAX_FOLLOWING_CHANGE_LOG,
    MAX_FRACTIONAL_LAG,
    MIN_CORRELATED_VARIANCE_RATIO,
    MIN_DISTINCT_PAIRS,
    MIN_EXPLAINED_SHARE,
    MIN_FRACTIONAL_LAG_LEAD,
    MIN_LAG_LEAD,
    MIN_LAG_SIGMAS,
    UNCOMMON_LAG_FACTOR,
)

LagState = Literal[
    "determined",
    "constant exposure",
    "too few pairs",
    "changes too small",
    "no response to exposure",
    "ambiguous",
    "refuted",
    "follows flicker",
    "between frames",
    "changing",
    "out of range",
]

UNRESPONSIVE: tuple[LagState, ...] = ("no response to exposure", "changes too small")
"""States in which the images do not respond to the exposures."""


@dataclass(frozen=True, eq=False)
class LagEstimate(ByValue):
    """The estimated lag of the exposures."""

    state: LagState
    """``"determined"``, or why the lag is not determined; ``"refuted"`` if the fit of response and vignette
    contradicts it."""
    candidates: tuple[int, ...]
    """Lags that cannot be excluded, best first."""
    lags: IntArray
    """Lags tried, shape (m,)."""
    score: FloatArray
    """Log likelihood of each lag relative to the best, shape (m,)."""
    sigmas: FloatArray
    """Lead of the best lag over each in standard deviations, shape (m,)."""
    fraction_frames: float = 0.0
    """Offset from the best lag to the fractional lag that fits best, in frames."""
    fit: LagFit | None = field(default=None, repr=False)
    """The fit at the best lag, or without exposures if they do not change; None without pairs."""
    frame: IntArray = field(default_factory=lambda: np.empty(0, np.int64), repr=False)
    """Index of the first frame of each pair of the fit, shape (pairs,)."""
    flicker: tuple[Flicker, ...] = ()
    """Periodic brightness changes that the exposures do not explain, strongest first."""

    @property
    def frames(self) -> int | None:
        """The lag L: frame i − L was taken with the exposure recorded for frame i. None if not determined."""
        return self.candidates[0] if self.state == "determined" else None

    @property
    def pairs(self) -> int:
        """Number of pairs of consecutive frames used."""
        return len(self.frame)

    def plus(self, frames: int) -> LagEstimate:
        """Return the estimate with the candidates relative to exposures that were moved by a number of frames."""
        return replace(self, candidates=tuple(lag + frames for lag in self.candidates))

    def certain_frames(self, cycle_frames: int | None) -> int | None:
        """Return the lag to correct exposures by; None if it is not certain.

        If exposures repeat after ``cycle_frames``, lags that differ by whole cycles give the same correction.
        """
        if self.frames is not None or self.state != "ambiguous" or cycle_frames is None:
            return self.frames
        smallest = min(self.candidates, key=abs)
        return None if any((lag - smallest) % cycle_frames for lag in self.candidates) else smallest


@dataclass(frozen=True)
class LagHypotheses:
    """Several lags, each fitted to the same brightness changes of n pairs of frames."""

    series: BrightnessSeries
    """The brightness changes."""
    log_exposure: FloatArray
    """ln of the exposure recorded for each frame, shape (frames,)."""
    lags: IntArray
    """The lags, shape (m,)."""
    changes: FloatArray
    """Change of ln exposure of each pair at each lag, shape (m, n)."""
    fits: tuple[LagFit, ...]
    """The fit at each lag."""
    flickers: tuple[Flicker, ...]
    """Flicker that was fitted as well."""
    nuisance: FloatArray | None
    """Its columns, shape (n, columns); None without flicker."""

    @classmethod
    def fit(
        cls, series: BrightnessSeries, log_exposure: FloatArray, lags: IntArray, flickers: tuple[Flicker, ...] = ()
    ) -> LagHypotheses:
        """Fit each lag to the brightness changes, together with any flicker."""
        changes = np.stack([series.exposure_change(log_exposure, lag) for lag in lags.tolist()])
        nuisance = waves(series.frame, [f.cycles_per_frame for f in flickers]) if flickers else None
        fits = tuple(fit_exposures(series, changes, nuisance))
        return cls(series, log_exposure, lags, changes, fits, flickers, nuisance)

    @property
    def best(self) -> int:
        """Index of the most likely lag."""
        return int(np.argmax([fit.total for fit in self.fits]))

    @property
    def max_log_likelihood(self) -> float:
        """Log likelihood of the most likely lag."""
        return self.fits[self.best].total

    @property
    def change_rms(self) -> float:
        """Root mean square change of ln exposure of the pairs, at the lag at which it is smallest."""
        return float(np.sqrt(np.mean(self.changes**2, axis=1)).min())

    def index_of(self, lag: int) -> int:
        """Return the index of a lag."""
        return int(np.flatnonzero(self.lags == lag)[0])

    @property
    def min_lead(self) -> float:
        """Log likelihood by which the best lag must lead: more for overlapping intervals and in flickering light."""
        return MIN_LAG_LEAD * float(np.sqrt(self.series.interval_frames)) * self.caution

    @property
    def caution(self) -> float:
        """Factor on the lead that the best lag needs, because of flickering light."""
        return FLICKER_LEAD_FACTOR if self.flickers else 1.0


def select_lag(tried: LagHypotheses) -> LagEstimate:
    """Accept the most likely lag, or state why it is not certain."""
    best = tried.best
    lead = np.array([tried.fits[best].total - fit.total for fit in tried.fits])
    sigmas = _lead_sigmas(tried, best)
    best, rivals, state = _resolve_cycle(tried, best, _rivals(tried, best, lead, sigmas))
    without = fit_exposures(tried.series, np.zeros((1, len(tried.series))), tried.nuisance)[0]
    unresponsive = _unresponsive(tried, best, without)
    fraction = _fraction(tried, best)
    if unresponsive is not None:
        state = unresponsive
    elif state == "determined":
        state = _objection(tried, best, fraction) or state
    return LagEstimate(
        state,
        candidates=() if unresponsive else (int(tried.lags[best]), *rivals),
        lags=tried.lags,
        score=-lead,
        sigmas=sigmas,
        fraction_frames=fraction,
        fit=without if unresponsive else tried.fits[best],
        frame=tried.series.frame,
        flicker=tried.flickers,
    )


def _lead_sigmas(tried: LagHypotheses, best: int) -> FloatArray:
    """Return the lead of the best lag over each lag in standard deviations, shape (m,)."""
    bandwidth = CORRELATED_PAIRS + tried.series.interval_frames - 1
    best_fit = tried.fits[best]
    sigmas = np.array([_mean_sigmas(best_fit.log_likelihood - fit.log_likelihood, bandwidth) for fit in tried.fits])
    sigmas[best] = 0.0
    return sigmas


def _rivals(tried: LagHypotheses, best: int, lead: FloatArray, sigmas: FloatArray) -> list[int]:
    """Return the lags that the best one does not clearly beat, most likely first."""
    # Number of pairs in which each lag predicts a clearly different brightness change.
    difference = float(np.median(tried.fits[best].slopes)) * np.abs(tried.changes[best] - tried.changes)
    distinct = np.count_nonzero(difference > DISTINCT_NOISE_SCALES * tried.fits[best].scale, axis=1)
    uncommon = (abs(tried.lags[best]) > MAX_COMMON_LAG) & (abs(tried.lags) <= MAX_COMMON_LAG)
    factor = np.where(uncommon, UNCOMMON_LAG_FACTOR, 1.0)
    min_lead, min_sigmas = tried.min_lead * factor**2, MIN_LAG_SIGMAS * tried.caution * factor
    possible = (lead < min_lead) | (sigmas < min_sigmas) | (distinct < MIN_DISTINCT_PAIRS)
    return [int(tried.lags[i]) for i in np.argsort(lead, kind="stable") if possible[i] and i != best]


def _resolve_cycle(tried: LagHypotheses, best: int, rivals: list[int]) -> tuple[int, list[int], LagState]:
    """Return the index of the lag, its rivals, and the state, resolving ambiguity due to periodic exposures."""
    # Lags that differ by whole cycles cannot be distinguished. If only one of them has a common size, it is selected,
    # and the others stay rivals.
    if not rivals:
        return best, rivals, "determined"
    cycle = exposure_cycle(tried.log_exposure)
    equivalent = [int(tried.lags[best]), *rivals]
    common = [lag for lag in equivalent if abs(lag) <= MAX_COMMON_LAG]
    if cycle is None or len(common) != 1 or any((lag - common[0]) % cycle for lag in equivalent):
        return best, rivals, "ambiguous"
    return tried.index_of(common[0]), [lag for lag in equivalent if lag != common[0]], "determined"


def _unresponsive(tried: LagHypotheses, best: int, without: LagFit) -> LagState | None:
    """Return why the images do not respond to the exposures, given the fit without them; None if they respond."""
    advantage = float((tried.fits[best].log_likelihood - without.log_likelihood).sum())
    explained_share = 1 - tried.fits[best].unexplained_share  # NaN if brightness does not change
    if advantage >= tried.min_lead and (tried.flickers or explained_share >= MIN_EXPLAINED_SHARE):
        return None
    lost_in_noise = FLAT_RESPONSE_SLOPE * tried.change_rms < without.scale
    return "changes too small" if lost_in_noise else "no response to exposure"


def _objection(tried: LagHypotheses, best: int, fraction_frames: float) -> LagState | None:
    """Return why a lag without rivals is not accepted; None if it is."""
    lag = abs(int(tried.lags[best]))
    if _exposures_follow_flicker(tried, best):
        return "follows flicker"
    # The likelihood may keep rising beyond the largest lag tried: auto exposure that follows a slowly varying light
    # leaves brightness changes that exposures at a large, meaningless lag fit.
    if MAX_COMMON_LAG < lag == np.abs(tried.lags).max():
        return "out of range"
    if abs(fraction_frames) > MAX_FRACTIONAL_LAG:
        return "between frames"
    return "changing" if _halves_differ(tried, best) else None


def _mean_sigmas(values: FloatArray, bandwidth: int) -> float:
    """Return a mean over its standard error for correlated pairs (Newey, West 1987: ``bandwidth``)."""
    centred = values - values.mean()
    independent = float(np.mean(centred**2))
    variance = independent
    for step in range(1, min(bandwidth, len(values) - 1) + 1):
        variance += 2 * (1 - step / (bandwidth + 1)) * float(np.mean(centred[step:] * centred[:-step]))
    variance = max(variance, independent * MIN_CORRELATED_VARIANCE_RATIO)
    return float(values.mean() * np.sqrt(len(values) / variance)) if variance > 0 else 0.0


def _fraction(tried: LagHypotheses, best: int) -> float:
    """Return the offset from a lag to the fractional lag that fits best, in frames."""
    if not 0 < best < len(tried.lags) - 1:
        return 0.0
    share = np.abs(FRACTIONAL_LAGS)[:, None]
    neighbours = tried.changes[best + np.sign(FRACTIONAL_LAGS).astype(int)]
    changes = (1 - share) * tried.changes[best] + share * neighbours
    totals = [fit.total for fit in fit_exposures(tried.series, changes, tried.nuisance)]
    top = int(np.argmax(totals))
    if totals[top] - totals[len(totals) // 2] < MIN_FRACTIONAL_LAG_LEAD:
        return 0.0
    return float(FRACTIONAL_LAGS[top])


def _exposures_follow_flicker(tried: LagHypotheses, best: int) -> bool:
    """Return whether nearly all fast exposure changes have the period of the flicker."""
    # Auto exposure that follows a flickering lamp is as periodic as the lamp, so the effects of lamp and exposure
    # cannot be separated. A programmed exposure cycle repeats exactly; auto exposure does not.
    if not tried.flickers or exposure_cycle(tried.log_exposure) is not None:
        return False
    fast = fast_part(tried.series.frame, tried.changes[best])
    # A bracket on top of slow auto exposure is programmed, too. A wrong lag of a whole bracket fits almost as well as
    # the true one, so only a lag of 0 is exempt.
    if tried.lags[best] == 0 and np.std(fast) > MAX_FOLLOWING_CHANGE_LOG:
        return False
    rest = without_waves(tried.series.frame, fast, [f.cycles_per_frame for f in tried.flickers])
    return bool(np.sum(rest**2) < (1 - FLICKERING_EXPOSURE_SHARE) * np.sum(fast**2))


def _halves_differ(tried: LagHypotheses, best: int) -> bool:
    """Return whether one half of the recording clearly prefers another lag."""
    half = len(tried.fits[best].log_likelihood) // 2
    for part in (slice(None, half), slice(half, None)):
        leads = [fit.log_likelihood[part] - tried.fits[best].log_likelihood[part] for fit in tried.fits]
        if any(lead.sum() > MIN_LAG_LEAD and _mean_sigmas(lead, CORRELATED_PAIRS) > MIN_LAG_SIGMAS for lead in leads):
            return True
    return False
